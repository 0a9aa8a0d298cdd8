import numpy as np

from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats, integers, zeros


@kernel
def on_the_stack(rows, out):
    square, fixed, counts = zeros(rows, rows), floats(2, 3), integers(rows)
    for i in range(rows):
        counts[i] = i
        square[i, i] = counts[i] + 1
    for i in range(2):
        for j in range(3):
            fixed[i, j] = 10 * i + j
    row = fixed[1]
    for i in range(rows):
        for j in range(rows):
            out[i, j] = square[i, j]
    out[0, rows] = row[2]


def test_arrays_on_the_stack_are_arrays():
    """Of sizes known beforehand and others, whole and in parts, compiled and as plain Python."""
    for rows in (1, 4, 50):
        ours, plain = np.zeros((2, rows, rows + 1))
        on_the_stack(rows, ours)
        on_the_stack.py_func(rows, plain)
        np.testing.assert_array_equal(ours, plain)
        np.testing.assert_array_equal(ours[:, :rows], np.diag(np.arange(1, rows + 1)))
        assert ours[0, rows] == 12.0
