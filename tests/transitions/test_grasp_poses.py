"""Joint angles above a point, folds and lines against windows and forward kinematics."""

import numpy as np
import pytest
from branches import arm_of, solutions
from compiled import called
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mlivr_gym import robot_spec
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.kinematics.chain import in_window
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.transitions.grasp_poses import (
    angles_above,
    folded,
    line_end,
)

TURNS = 2.0 * np.pi * np.arange(-12, 13)
SPEC = robot_spec("mlivr2")
ROBOT = LimbShapes(SPEC)
ANGLE = st.floats(-12.0, 12.0)
JOINTS = st.lists(ANGLE, min_size=6, max_size=6).map(np.array)


def angles(q):
    out = Angles.row()
    out["q"] = q
    return out


@given(ANGLE, st.floats(-9.0, 9.0))
@settings(deadline=None)
def test_one_winding_of_an_angle_lies_in_a_window(angle, low):
    assume(np.abs(angle + TURNS - low).min() > 1e-5)
    inside = [turn for turn in angle + TURNS if low <= turn < low + 2.0 * np.pi]
    assert called(in_window)(angle, low) == pytest.approx(inside[0], abs=1e-9)
    assert len(inside) == 1


@pytest.mark.parametrize("off", [-1e-9, 0.0, 1e-9])
@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_noise_does_not_choose_the_winding_where_a_window_begins(off, turns):
    low = -0.75 * np.pi
    found = called(in_window)(low + off + 2.0 * np.pi * turns, low)
    assert found == pytest.approx(low, abs=1e-8)


@given(JOINTS, JOINTS)
@settings(deadline=None)
def test_a_line_ends_at_the_angles_with_the_tool_at_the_nearest_half_turn(first, last):
    off = np.sort(np.abs(last[5] + 0.5 * TURNS - first[5]))
    assume(off[1] - off[0] > 1e-6)
    to = Angles.row()
    found = called(line_end)(angles(first), angles(last), to)
    tool = min(last[5] + 0.5 * TURNS, key=lambda turn: abs(turn - first[5]))
    np.testing.assert_allclose(to["q"], [*last[:5], tool], atol=1e-9)
    assert found == pytest.approx(np.abs(last - first)[:5].max(), abs=1e-9)


@given(ANGLE, st.integers(0, len(SPEC.folds) - 1))
@settings(deadline=None)
def test_a_fold_is_that_of_the_robot_in_its_windows(tool, fold):
    to, windows = Angles.row(), SPEC.limb.windows
    called(folded)(ROBOT.robot, fold, tool, to)
    np.testing.assert_allclose(np.exp(1j * to["q"][:5]), np.exp(1j * np.array(SPEC.folds[fold])))
    assert to["q"][5] == tool
    assert (to["q"][:5] >= windows[:5, 0]).all()
    assert (to["q"][:5] <= windows[:5, 1]).all()


@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize("seed", range(2))
def test_angles_above_a_point_put_the_flange_the_lift_off_along_the_normal(i, seed):
    """They exist where inverse kinematics has a solution there, and reach it."""
    rng = np.random.default_rng(seed)
    mount, origin = SPEC.mount_rotations[i], SPEC.mount_positions[i]
    frame = link_frames(SPEC.limb, rng.uniform(-np.pi, np.pi, 6))[6]
    axes = mount @ frame[:3, :3]
    normal, rail = -axes[:, 2], axes[:, 0]
    point = origin + mount @ frame[:3, 3] - (SPEC.tool_length + SPEC.lift) * normal
    grasp = grasp_rows(point[None], normal[None], rail[None], SPEC.tool_length)[0]
    base, to = pose(np.zeros(3), np.eye(3)), Angles.row()
    branch_set, _ = solutions(arm_of(SPEC.limb), frame[:3, 3], frame[:3, :3], 0.0)
    assert branch_set
    for branch in range(8):
        found = angles_above(ROBOT.rows, i, base, grasp, branch, to)
        assert found == bool(branch_set >> branch & 1)
        if found:
            reached = link_frames(SPEC.limb, to["q"])[6]
            np.testing.assert_allclose(reached, frame, atol=1e-7)
            assert (to["q"] >= SPEC.limb.windows[:, 0] - 1e-5).all()
            assert (to["q"] <= SPEC.limb.windows[:, 1]).all()
