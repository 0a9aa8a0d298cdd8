"""Kernels, which compiled code alone can call, called from tests."""

from functools import cache

from numba import njit


@cache
def called(kernel):
    """A function that calls a kernel with the arguments it is given."""
    return njit(error_model="numpy")(lambda *args: kernel(*args))
