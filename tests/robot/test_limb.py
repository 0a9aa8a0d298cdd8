"""Windows of joints against their definition, tried angle by angle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym import Limb
from mlivr_gym.collisions.limb_shapes import folds_in_windows

TURN = 2.0 * np.pi
ANGLES = st.floats(-20.0, 20.0)


@st.composite
def limbs(draw):
    """Limbs whose joints turn less than a turn, one, or more, wherever their windows begin."""
    low = [draw(ANGLES) for _ in range(6)]
    width = [draw(st.one_of(st.just(TURN), st.floats(0.1, 3.0 * TURN))) for _ in range(6)]
    limits = tuple((a, a + b) for a, b in zip(low, width, strict=True))
    return Limb(joint_limits=limits, window_starts=tuple(draw(ANGLES) for _ in range(6)))


@given(limbs())
def test_a_window_is_a_turn_within_the_limits_or_all_that_they_allow(limb):
    """As near to its start as limits let it lie, and one winding of every angle."""
    for (start, end), (low, high), wanted in zip(
        limb.windows, limb.joint_limits, limb.window_starts, strict=True
    ):
        assert low <= start
        assert end <= high
        assert end - start == pytest.approx(min(TURN, high - low))
        near = np.linspace(low, max(low, high - TURN), 1001)
        assert abs(start - wanted) <= np.abs(near - wanted).min() + 1e-9


@given(limbs(), st.lists(st.lists(ANGLES, min_size=5, max_size=5), max_size=4))
def test_folds_are_kept_where_some_winding_of_every_joint_lies_in_its_window(limb, folds):
    windings = TURN * np.arange(-20, 21)
    expected = []
    for fold in folds:
        inside = [
            [angle + k for k in windings if low <= angle + k <= high]
            for angle, (low, high) in zip(fold, limb.windows, strict=False)
        ]
        if all(inside):
            expected.append([values[0] for values in inside])
    found = folds_in_windows(limb, folds)
    np.testing.assert_allclose(found, np.array(expected).reshape(-1, 5), atol=1e-9)
