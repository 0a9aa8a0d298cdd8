"""Windings and joint angles above a point against all windings and forward kinematics."""

import numpy as np
import pytest
from branches import arm_of, solutions
from compiled import called
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mlivr_gym import Limb, robot_spec
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.kinematics.families import forward_kinematics
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.transitions.grasp_poses import (
    angles_above,
    fold_of_limb,
    line_end,
    line_of_limb,
    nearest_turn,
)

TURNS = 2.0 * np.pi * np.arange(-12, 13)
SPEC = robot_spec("mlivr2")
ROBOT = LimbShapes(SPEC)
ANGLE = st.floats(-12.0, 12.0)
JOINTS = st.lists(ANGLE, min_size=6, max_size=6).map(np.array)
NARROW = Limb(
    joint_limits=((-3.5, 3.0), (-2.0, 5.0), (-6.5, 6.5), (0.5, 9.0), (-7.0, 1.0), (-4, 4))
)


def plain_turn(angle, q, low, high):
    """The winding of an angle inside limits that is nearest to `q`, NaN if none is inside."""
    inside = [turn for turn in angle + TURNS if low <= turn <= high]
    return min(inside, key=lambda turn: abs(turn - q)) if inside else np.nan


def angles(q):
    out = Angles.row()
    out["q"] = q
    return out


def clearly_inside(values, limits):
    """Whether no value lies so close to a limit, or between two windings, that rounding decides."""
    return np.abs(np.asarray(values)[..., None] - limits).min() > 1e-6


@given(ANGLE, st.floats(-9.0, 9.0), st.floats(-9.0, 0.0), st.floats(0.0, 9.0))
@settings(deadline=None)
def test_the_nearest_winding_inside_the_limits(angle, q, low, high):
    assume(low <= q <= high)  # a limb is inside its limits before it moves
    assume(clearly_inside(angle + TURNS, [low, high]))
    off = np.sort(np.abs(angle + TURNS - q))
    assume(off[1] - off[0] > 1e-6)
    found = called(nearest_turn)(angle, q, low, high)
    np.testing.assert_allclose(found, plain_turn(angle, q, low, high), atol=1e-9)


@given(JOINTS, JOINTS)
@settings(deadline=None)
def test_a_line_ends_on_the_nearest_windings(first, last):
    """The tool may be turned by half a turn."""
    limits = NARROW.limits
    first = np.clip(first, limits[:, 0], limits[:, 1])
    for joint in range(6):
        windings = last[joint] + (0.5 if joint == 5 else 1.0) * TURNS
        off = np.sort(np.abs(windings - first[joint]))
        assume(off[1] - off[0] > 1e-6)
        assume(clearly_inside(windings, limits[joint]))
    to = Angles.row()
    found = called(line_end)(angles(first), angles(last), arm_of(NARROW), to)
    ends = [plain_turn(last[k], first[k], *limits[k]) for k in range(5)]
    tool = min(last[5] + 0.5 * TURNS, key=lambda turn: abs(turn - first[5]))
    if np.isnan(ends).any() or not limits[5, 0] <= tool <= limits[5, 1]:
        assert found == np.inf
        return
    np.testing.assert_allclose(to["q"], [*ends, tool], atol=1e-9)
    assert found == pytest.approx(np.abs(np.array(ends) - first[:5]).max(), abs=1e-9)


@given(JOINTS.map(lambda q: q / 2.0), st.integers(0, len(SPEC.folds) - 1))
@settings(deadline=None)
def test_a_fold_on_the_windings_nearest_to_where_a_limb_is(q, fold):
    limits = SPEC.limb.limits
    for joint in range(5):
        off = np.sort(np.abs(SPEC.folds[fold][joint] + TURNS - q[joint]))
        assume(off[1] - off[0] > 1e-6)
    truth = [plain_turn(SPEC.folds[fold][k], q[k], *limits[k]) for k in range(5)]
    to = Angles.row()
    for i in range(2):
        assert fold_of_limb(ROBOT.rows, i, fold, angles(q), to)
        np.testing.assert_allclose(to["q"], [*truth, q[5]], atol=1e-9)


@given(JOINTS.map(lambda q: q / 2.0), JOINTS)
@settings(deadline=None)
def test_a_line_of_a_limb_is_that_of_its_arm(first, last):
    one, other = Angles.row(), Angles.row()
    truth = called(line_end)(angles(first), angles(last), arm_of(SPEC.limb), one)
    assert line_of_limb(ROBOT.rows, 1, angles(first), angles(last), other) == truth
    np.testing.assert_array_equal(one["q"], other["q"])


@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize("seed", range(5))
def test_angles_above_a_point_put_the_flange_the_lift_off_along_the_normal(i, seed):
    """They exist where inverse kinematics has a solution there, and reach it."""
    rng = np.random.default_rng(seed)
    mount, origin = SPEC.mount_rotations[i], SPEC.mount_positions[i]
    frame = forward_kinematics(rng.uniform(-np.pi, np.pi, 6), SPEC.limb.lengths)[6]
    axes = mount @ frame[:3, :3]
    normal, rail = -axes[:, 2], axes[:, 0]
    point = origin + mount @ frame[:3, 3] - (SPEC.tool_length + SPEC.lift) * normal
    grasp = grasp_rows(point[None], normal[None], rail[None], SPEC.tool_length)[0]
    base, to = pose(np.zeros(3), np.eye(3)), Angles.row()
    mask, _ = solutions(arm_of(SPEC.limb), frame[:3, 3], frame[:3, :3], 0.0)
    assert mask
    for branch in range(8):
        found = angles_above(ROBOT.rows, i, base, grasp, branch, to)
        assert found == bool(mask >> branch & 1)
        if found:
            reached = forward_kinematics(to["q"], SPEC.limb.lengths)[6]
            np.testing.assert_allclose(reached, frame, atol=1e-7)
            assert (np.abs(to["q"]) <= np.pi + 1e-9).all()
