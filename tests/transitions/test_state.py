"""States, and the steps that leave one."""

import numpy as np
import pytest

from mlivr_gym.transitions.state import State, Successors, moving_limb

STATE = State((4, 7, 9), (1, 2, 4))
STEPS = Successors(
    np.array([0, 2]), np.array([5, 8]), np.zeros((2, 3)), np.array([[9, 2, 4], [1, 2, 6]])
)


def test_a_step_changes_the_point_of_the_limb_that_moves_and_takes_the_masks_after_it():
    assert STATE.stance_after(1, 3) == (4, 3, 9)
    assert STEPS.after(STATE, 0) == State((5, 7, 9), (9, 2, 4))
    assert STEPS.after(STATE, 1) == State((4, 7, 8), (1, 2, 6))


def test_a_given_pose_is_left_with_the_first_step():
    assert STEPS.after(STATE._replace(pose=(0.0,) * 7), 1).pose is None


def test_steps_are_found_by_limb_and_point():
    assert (STEPS.find(2, 8), STEPS.find(2, 5), STEPS.find(1, 8)) == (1, -1, -1)
    assert bool(STEPS)
    assert not STEPS.take(np.array([], dtype=np.int64))
    assert STEPS.take(np.array([1])).after(STATE, 0) == STEPS.after(STATE, 1)


def test_the_limb_that_moves_is_the_one_whose_point_differs():
    assert [moving_limb((1, 2, 3), after) for after in ((4, 2, 3), (1, 2, 5))] == [0, 2]
    with pytest.raises(StopIteration):
        moving_limb((1, 2), (1, 2))
