"""Lines in joint space are clear at less than five sixths of their smallest distance, and never at
5/4 of it.

Lines of both limbs are drawn at random and sampled densely; at every sample Coal measures the
distances of the shapes that are compared. The check must reject a clearance that is a quarter
larger than the smallest distance, and accept one that is a sixth smaller.
"""

from collections import Counter
from copy import deepcopy

import numpy as np
import pytest
from arms import jacobian
from coal_ruler import PLATE, ROD, Ruler, grasps_of
from compiled import called
from joint_lines import configurations, flange_in_body, line_scratch
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, robot_spec
from mlivr_gym.collisions.base_path import base_path, base_poses, set_path
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.followers import choose_branch, set_follower
from mlivr_gym.collisions.intervals import WHOLE, check_line
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.kinematics.limb import Angles, all_angles_at
from mlivr_gym.kinematics.poses import pose, poses
from mlivr_gym.robot.rigid import rigid

ROBOT = robot_spec("mlivr2")
SHAPES = LimbShapes(ROBOT)
RULER = Ruler(ROBOT)
SHARES, FINE = np.linspace(0.0, 1.0, 61), np.linspace(0.0, 1.0, 301)
STANDS_OUT = 0.37 * 0.5 * ROBOT.body_size
"""How far the base capsules that boxes are compared with protrude from the body."""
ON_AXIS = {
    f"limb1/{link}/0"
    for link in SHAPES.each[1].names[int(SHAPES.robot["limbs"][1]["first_on_axis"]) :]
}
COMPARED = {
    "boxes": {"boxes": 1}, "base": {"base": True}, "itself": {"itself": 1},
    "second": {"second": 1}, "follower": {"boxes": 2, "holding": 2},
}  # fmt: skip
FLOOR = 0.03 * 0.87**3
"""Least `|det J|` of a limb that follows [m^3]."""
"""What is compared, by fields of `Compared`: limb 0 with boxes, itself and body, limb 1; the base
or the limb that follows it with boxes."""


def are_compared(name):
    """Return whether two shapes, the second of which may be the box, are compared."""

    def compared(first, second):
        limbs = [n[:5] for n in (first, second) if n.startswith("limb") and "/base/" not in n]
        fixed = [n == "body" or "/base/" in n for n in (first, second)]
        if second == "box":
            return {
                "boxes": limbs == ["limb0"],
                "base": fixed[0],
                "follower": limbs == ["limb1"] and first not in ON_AXIS,
            }.get(name, False)
        if name == "itself":
            return set(limbs) == {"limb0"}
        return name == "second" and set(limbs) == {"limb0", "limb1"} and len(limbs) == 2

    return compared


def answer(scratch, clearance, boxes=()):
    return called(check_line)(SHAPES.robot, box_grid(boxes), clearance, WHOLE, scratch)


def random_line(rng, name, size, shares=SHARES):
    """A line of limb 0 beside the other at rest, and the configurations at shares of it."""
    start = rng.uniform(-np.pi, np.pi, (2, 6))
    joints = np.stack([start, start + rng.uniform(-size, size, (2, 6))])
    frame = rigid(Rotation.random(None, rng).as_matrix(), rng.uniform(-0.2, 0.2, 3))
    joints[1, 1] = joints[0, 1]
    scratch = line_scratch(joints, frame, **COMPARED[name])
    return scratch, configurations(joints, frame, shares)


def follower_line(rng, name):
    """The same while the base moves straight and limb 1 holds and follows it."""
    while True:
        q = rng.uniform(-0.9 * np.pi, 0.9 * np.pi, (2, 6))
        turn, shift = rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.25, 0.25, 3)
        ends = [pose(s * shift, Rotation.from_rotvec(s * turn).as_matrix()) for s in (-0.5, 0.5)]
        joints = np.stack([q, q + rng.uniform(-0.3, 0.3, (2, 6))])
        flange = flange_in_body(ROBOT, 1, q[1])
        held = pose(flange[:3, 3], flange[:3, :3])
        where, branch = followed(ends, held, joints)
        if where is None:
            continue
        scratch = line_scratch(joints, None, **COMPARED[name])
        called(set_path)(scratch["line"]["path"], *ends)
        called(set_follower)(1, held, scratch)
        called(choose_branch)(1, branch, 1 << branch, scratch)
        scratch["floor"] = FLOOR
        return scratch, where


def followed(ends, held, joints):
    """The robot at samples of a straight way, with limb 1 on a branch; None where it cannot hold.

    By closed form; limits that a check may not yet tell from those kept are kept by a tenth more.
    """
    positions, rotations = base_poses(base_path(*ends), SHARES)
    quaternions = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    found = np.empty((len(SHARES), 8, 6))
    for k, base in enumerate(poses(positions, rotations)):
        out = Angles.rows(8)
        all_angles_at(SHAPES.rows, 1, base, held, out)
        found[k] = out["q"]
    middle = found[len(SHARES) // 2] - joints[0, 1]
    off = np.abs((middle + np.pi) % (2.0 * np.pi) - np.pi)[:, :5].max(axis=1)
    branch = int(np.nanargmin(off))
    q = found[:, branch]
    low, high = ROBOT.every_limb[1].windows.T
    if np.isnan(q).any() or (q < low + 0.05).any() or (q > high - 0.05).any():
        return None, branch
    regular = [abs(np.linalg.det(jacobian(ROBOT.every_limb[1], one))) for one in q]
    if min(regular) < 1.1 * FLOOR:
        return None, branch
    swing = joints[0] + SHARES[:, None, None] * (joints[1] - joints[0])
    swing[:, 1] = q
    return [*zip(positions, quaternions, swing, strict=True)], branch


def near_box(rng, where, name, n):
    """A plate, a rod or a crate next to what is compared, somewhere along a line."""
    position, quaternion, joints = where[int(rng.integers(len(where)))]
    point = position
    if name != "base":
        ends = capsule_ends(ROBOT, SHAPES, (position, quaternion, joints))[int(name == "follower")]
        point = ends[int(rng.integers(3))].mean(axis=0)
    half = (PLATE, ROD, (0.05, 0.1, 0.02))[n % 3]
    axes = Rotation.random(None, rng).as_matrix()
    away = rng.uniform(0.05, 0.2) + (0.15 if name == "base" else 0.0)
    out = rng.choice((-1.0, 1.0)) * (half[2] + away) * axes[:, 2]
    return Box("box", "obstacle", tuple(point + out), half, Box.rows(axes))


def least(ruler, where, below):
    """The smallest distance, the same with the wider base, and the names of both shapes."""
    found = [pair for here in where for pair in ruler.measured(here, (), below)]
    if not found:
        return None
    wide = min(gap - STANDS_OUT * (names == ["body", "box"]) for gap, *names in found)
    return min(found), wide


@pytest.mark.parametrize("size", [0.3, 1.5])
@pytest.mark.parametrize("name", ["boxes", "itself", "second"])
def test_a_line_keeps_clear_and_no_more(name, size):
    rng, found, counted, is_long = np.random.default_rng(0), Counter(), 0, size > 1.0
    # An interval of the last depth of a long line is still millimetres long.
    nearest = 0.06 if is_long else 0.02
    ruler = RULER.only(are_compared(name))
    for n in range(600):
        scratch, where = random_line(rng, name, size, FINE if is_long else SHARES)
        boxes = (near_box(rng, where, name, n),) if name == "boxes" else ()
        ruler.among(boxes)
        here = least(ruler, where[::15], 0.3)
        if here is None or here[0][0] < nearest:
            continue
        (gap, *names), wide = least(ruler, where, 0.3)
        if not nearest < gap < 0.25:
            continue
        assert answer(deepcopy(scratch), gap / 0.8, boxes) != CLEAR
        counted += 1
        if wide > nearest:
            assert answer(deepcopy(scratch), wide / 1.2, boxes) == CLEAR
            found[tuple(names)] += 1
        if sum(found.values()) >= 5:
            break
    assert counted >= 5
    assert len(found) > 1


@pytest.mark.parametrize("name", ["boxes", "base", "itself follower", "second", "follower"])
def test_a_straight_way_with_a_limb_that_follows_keeps_clear_and_no_more(name):
    """As on lines; the limb that follows is compared with boxes, itself, and the other limb."""
    rng, counted, found = np.random.default_rng(2), 0, Counter()
    compared = are_compared("itself" if "itself" in name else name)
    of_follower = "itself" in name
    ruler = RULER.only(
        (lambda a, b: {a[:5], b[:5]} == {"limb1"} and "/base/" not in a + b)
        if of_follower
        else compared
    )
    for n in range(600):
        scratch, where = follower_line(rng, "follower" if of_follower else name)
        if of_follower:
            scratch["compared"]["boxes"], scratch["compared"]["itself"] = 0, 2
        boxes = (near_box(rng, where, name, n),) if name in ("boxes", "base", "follower") else ()
        ruler.among(boxes)
        here = least(ruler, where, 0.3)
        if here is None or not 0.02 < here[0][0] < 0.25:
            continue
        (gap, *names), wide = here
        # The body is part of what a limb is compared with besides itself.
        assert answer(deepcopy(scratch), gap / 0.8, boxes) != CLEAR
        counted += 1
        if wide > 0.02 and not of_follower:
            assert answer(deepcopy(scratch), wide / 1.2, boxes) == CLEAR
            found[tuple(names)] += 1
        if sum(found.values()) >= 5 or (counted >= 8 and name in ("base", "itself follower")):
            break
    assert counted >= 5


def test_a_limb_that_follows_is_lost_where_it_cannot_hold():
    """On long ways: what is proved to follow exists at every sample, inside the windows."""
    rng, counts = np.random.default_rng(3), Counter()
    for _ in range(300):
        q = rng.uniform(-0.9 * np.pi, 0.9 * np.pi, (2, 6))
        shift, turn = rng.uniform(-0.6, 0.6, 3), rng.uniform(-0.6, 0.6, 3)
        ends = [pose(s * shift, Rotation.from_rotvec(s * turn).as_matrix()) for s in (-0.5, 0.5)]
        flange = flange_in_body(ROBOT, 1, q[1])
        held, joints = pose(flange[:3, 3], flange[:3, :3]), np.stack([q, q])
        where, branch = followed(ends, held, joints)
        scratch = line_scratch(joints, None, placed=2)
        called(set_path)(scratch["line"]["path"], *ends)
        called(set_follower)(1, held, scratch)
        called(choose_branch)(1, branch, 1 << branch, scratch)
        scratch["floor"] = FLOOR
        follows = answer(scratch, 0.0) == CLEAR
        if where is not None:
            assert follows
        if follows and where is None:
            positions, rotations = base_poses(base_path(*ends), SHARES)
            for base in poses(positions, rotations):
                out = Angles.rows(8)
                all_angles_at(SHAPES.rows, 1, base, held, out)
                q = out["q"][branch]
                assert np.isfinite(q).all()
                assert (q[:5] <= ROBOT.every_limb[1].windows[:5, 1] + 1e-6).all()
        counts[follows] += 1
    assert min(counts.values()) > 15


def test_limbs_at_rest_and_boxes_behind_a_grasp(small_checked_graph):
    """The first limb departs from a point beside the other one, which is at rest on a branch."""
    graph, rng, found = small_checked_graph, np.random.default_rng(7), Counter()
    ruler = RULER.only(are_compared("second"))
    for _ in range(200):
        s = int(rng.integers(len(graph)))
        stance = graph.points[s].tolist()
        state = graph.state(tuple(stance))
        position, quaternion, joints = graph.configuration(state)
        moved = joints.copy()
        moved[0] += rng.uniform(-0.7, 0.7, 6)
        frame = rigid(Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), position)
        scratch = line_scratch(np.stack([joints, moved]), frame, resting=True)
        ends = capsule_ends(ROBOT, SHAPES, (np.zeros(3), np.array([1.0, 0, 0, 0]), joints))[1]
        resting = scratch["resting"]
        resting["count"], resting["limb"][:3] = 3, 1
        for k, off in enumerate(rng.permutation([0.0, 9.0, -9.0])):
            resting["shapes"][k]["ends"][: len(SHAPES)] = ends + off
        where = configurations(np.stack([joints, moved]), frame, SHARES)
        if (here := least(ruler, where, 0.6)) is None or here[0][0] < 0.02:
            continue
        gap, *names = here[0]
        assert answer(deepcopy(scratch), gap / 0.8) != CLEAR
        assert answer(deepcopy(scratch), gap / 1.2) == CLEAR
        found[tuple(names)] += 1
        if sum(found.values()) > 8:
            break
    assert len(found) > 1
    # The gripper of a limb at a grasp touches the wall behind it; no other part may.
    (_, point, normal), *_ = grasps_of(graph, [(0, stance[0])])
    wall = Box("box", "obstacle", tuple(point - 0.05 * normal), (0.05, 0.05, 0.05))
    scratch = line_scratch(np.stack([joints, joints]), frame, boxes=1)
    assert answer(deepcopy(scratch), 0.02, (wall,)) != CLEAR
    scratch["surface"]["applies"] = True
    scratch["surface"]["point"], scratch["surface"]["normal"] = point, normal
    assert answer(scratch, 0.001, (wall,)) == CLEAR
