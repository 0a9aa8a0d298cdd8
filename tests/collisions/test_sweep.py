"""Motions are clear at less than five sixths of their smallest distance, and never at 5/4 of it.

Motions of limb 0 are drawn at random and sampled densely; at every sample Coal measures the
distances of the shapes that are compared. The check must reject a clearance that is a quarter
larger than the smallest distance, and accept one that is a sixth smaller.
"""

import itertools
from collections import Counter
from typing import NamedTuple

import numpy as np
import pytest
from coal_ruler import PLATE, ROD, Ruler, grasps_of
from compiled import called
from held_paths import path_between
from limb_motions import (
    FIRST_ON_AXIS,
    REST,
    ROBOT,
    SHAPES,
    answer,
    at_corner,
    departing,
    held_joints,
    holding,
    in_body,
    let_rest,
    motion,
    round_corner,
    swinging,
)
from scipy.spatial.transform import Rotation

from mlivr_gym import Box
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.sweep import set_joints
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, base_poses
from mlivr_gym.kinematics.limb import angles_at
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.transitions.state import State

RULER = Ruler(ROBOT)

SHARES, FINE = np.linspace(0.0, 1.0, 61), np.linspace(0.0, 1.0, 121)
"""Samples of a motion, and of a long one."""

STANDS_OUT = 0.37 * 0.5 * ROBOT.body_size
"""How far the base capsules that boxes are compared with protrude from the body."""

ON_AXIS = {f"limb0/{link}/0" for link in SHAPES.names[FIRST_ON_AXIS:]}


class Case(NamedTuple):
    """A motion to be checked, and the configuration of the robot at samples of it."""

    scratch: object
    moments: list
    grasps: tuple = ()

    def compared(self, first, second):
        """Return whether two shapes, the second of which may be the box, are compared."""
        moves = self.scratch["motion"]
        fixed = [name == "body" or "/base/" in name for name in (first, second)]
        checked = [name.startswith("limb0/") for name in (first, second)]
        if second == "box":
            still = moves["first"]["kind"] != 0 or moves["begin"] == moves["finish"]
            on_limb = checked[0] and not fixed[0] and not (self.held and first in ON_AXIS)
            return bool(moves["boxes"]) and (on_limb or (fixed[0] and not still))
        if not any(one and not base for one, base in zip(checked, fixed, strict=True)):
            return False
        if all(checked) or any(fixed):
            return bool(moves["body"])
        return bool(moves["resting"] or moves["meeting"])

    @property
    def held(self):
        return self.scratch["motion"]["first"]["kind"] == 1

    def least(self, ruler, below):
        """Return the smallest distance, the same with a larger body, and the two shapes.

        The check must reject clearances above the first, and may reject clearances above the
        second.
        """
        exact, wide = (below, "", ""), below
        for here in self.moments:
            for gap, *pair in ruler.measured(here, self.grasps, below):
                exact = min(exact, (gap, *pair))
                wide = min(wide, gap - STANDS_OUT * (pair == ["body", "box"]))
        return exact, wide

    def agrees(self, ruler, boxes=(), most=0.1):
        """Check at both clearances; return the closest shapes, or None if too close or too far."""
        middle = Case(self.scratch, self.moments[30:31], self.grasps).least(ruler, 1.5 * most)[0][0]
        if not 0.0 < middle < 1.5 * most:
            return None
        (gap, *pair), wide = self.least(ruler, 1.5 * most)
        if not 0.02 < gap < most:
            return None
        assert answer(self.scratch, gap / 0.8, boxes) != CLEAR
        if wide > 0.02:
            assert answer(self.scratch, wide / 1.2, boxes) == CLEAR
        return pair


def along(start, corner, end, rounded, shares=SHARES):
    """Return samples of a line or a rounded corner between values, shape (k, n)."""
    start, corner, end = (np.asarray(values, dtype=float) for values in (start, corner, end))
    if rounded:
        return at_corner(start, corner, end, shares)
    return start + shares[:, None] * (end - start)


def knots(rng, size=0.3):
    """Return joint angles at the start, the corner and the end of a swing."""
    start = rng.uniform(-np.pi, np.pi, 6)
    return np.array([start, *(start + rng.uniform(-size, size, (2, 6)))])


def base_motion(rng, kind):
    """Return a path of a kind, or at rest if None, and its parameter at start, corner and end."""
    if kind is None:
        return REST, np.zeros(3)
    turn = Rotation.random(rng=rng)
    first, pivot = np.zeros(3), rng.uniform((-0.3, -0.3, -1.1), (0.3, 0.3, -0.5))
    after = (turn * Rotation.from_rotvec(rng.uniform(-0.15, 0.15, 3))).as_matrix()
    path = path_between((first, turn.as_matrix(), rng.uniform(-0.2, 0.2, 3), after), kind, pivot)
    return path, np.array([0.0, rng.uniform(), 1.0])


def moments_of(path, places, first, second):
    """Return configurations at samples: base positions (k,), joint angles of both limbs (k, 6)."""
    where, turned = base_poses(path, places)
    joints = np.stack([first, np.broadcast_to(second, first.shape)], axis=1)
    quaternions = Rotation.from_matrix(turned).as_quat(scalar_first=True)
    return list(zip(where, quaternions, joints, strict=True))


def thin_box(rng, case, n):
    """Return a plate, a rod or a crate next to a limb somewhere along its motion."""
    here = case.moments[int(rng.integers(len(case.moments)))]
    turn = Rotation.from_quat(here[1], scalar_first=True).as_matrix()
    ends = in_body(0, [here[2][0]])[0]
    point = here[0] + turn @ ends[int(rng.integers(len(ends)))].mean(axis=0)
    half = (PLATE, ROD, (0.05, 0.1, 0.02))[n % 3]
    axes = Rotation.random(rng=rng).as_matrix()
    out = rng.choice((-1.0, 1.0)) * (half[2] + rng.uniform(0.05, 0.2)) * axes[:, 2]
    return Box("box", "obstacle", tuple(point + out), half, Box.rows(axes))


def carry_on(rng, make, boxes, wanted, most=0.1):
    """Draw cases until enough of them come close; count how often each pair was the closest."""
    case, found = make(), Counter()
    ruler = RULER.only(case.compared)
    for n in range(400):
        near = (thin_box(rng, case, n),) if boxes else ()
        ruler.among(near)
        pair = case.agrees(ruler, near, most)
        found.update([tuple(name.split("/")[-2] if "/" in name else name for name in pair or ())])
        if n + 1 - found[()] >= wanted:
            del found[()]
            return found
        case = make()
    raise AssertionError("too few motions were near")


@pytest.mark.parametrize("rounded", [False, True], ids=["line", "corner"])
@pytest.mark.parametrize(
    ("compared", "kind"),
    [*itertools.product(["boxes", "limb"], [None, STRAIGHT, ARC]), ("body", None), ("body", ARC)],
)
def test_a_swing_keeps_clear_and_no_more(compared, kind, rounded):
    """Limb 1 rests on one of three branches, or swings at the same time where the base moves."""
    rng = np.random.default_rng(0)

    def make():
        path, base = base_motion(rng, kind)
        ours, theirs = knots(rng), knots(rng)
        name = {"limb": "resting" if kind is None else "meeting"}.get(compared, compared)
        lines = [swinging(i, joints[0], joints[2]) for i, joints in enumerate((ours, theirs))]
        scratch = motion(path, (base[0], base[2]), *lines, (name,))
        if rounded:
            round_corner(scratch, base[1], ours[1], theirs[1])
        at = along(*base[:, None], rounded)[:, 0]
        second = along(*theirs, rounded)
        if name == "resting":
            second = theirs[0]
            far = in_body(1, [second])
            let_rest(scratch, 1, rng.permutation(np.concatenate([far, far + 9.0, far - 9.0])))
        return Case(scratch, moments_of(path, at, along(*ours, rounded), second))

    found = carry_on(rng, make, compared == "boxes", 8)
    assert len(found) > 1


def holding_on_a_step(graph, rng):
    """Return how limb 0 holds on a random edge: base path, point, branch, and its motion."""
    branch_set = 0
    while not branch_set:
        s0 = int(rng.integers(len(graph)))
        s1 = int(rng.choice(graph.row(0, s0)))
        branch_set = int(graph.kept_branches(0, s0, np.array([s1]))[0])
    bit = int(rng.choice([b for b in range(16) if branch_set >> b & 1]))
    before, after = (tuple(graph.points[s].tolist()) for s in (s0, s1))
    postures = join(graph.posture(before), graph.posture(after))
    edge = graph.edge(State(before, (1 << bit, 1 << bit)), after, postures)
    ends = (at[s] for s in (s0, s1) for at in (graph.base_position, graph.base_rotation))
    path = path_between(tuple(ends), edge.path_kind, graph.solver.grasps["point"][before[0]])
    flange = graph.solver.grasps["flange"][before[0]]
    holds = holding(0, bit & 7, flange["position"], flange["rotation"])
    return path, before[0], bit & 7, holds


@pytest.mark.parametrize("compared", ["boxes", "body", "line", "corner"])
def test_a_limb_that_holds_keeps_clear_and_no_more(small_checked_graph, compared):
    """While the base moves, compare with boxes (not on the flange axis) and a swinging limb."""
    rng, rounded = np.random.default_rng(1), compared == "corner"

    def make():
        path, point, branch, holds = holding_on_a_step(small_checked_graph, rng)
        base, theirs = np.array([0.0, rng.uniform(), 1.0]), knots(rng)
        names = (compared if compared in ("boxes", "body") else "meeting",)
        line = swinging(1, theirs[0], theirs[2])
        scratch = motion(path, (0.0, 1.0), holds, line, names)
        if rounded:
            round_corner(scratch, base[1], np.zeros(6), theirs[1])
        at = along(*base[:, None], rounded)[:, 0]
        ours = held_joints(small_checked_graph, 0, point, branch, path, at)
        return Case(scratch, moments_of(path, at, ours, along(*theirs, rounded)))

    carry_on(rng, make, compared == "boxes", 8)


def test_two_limbs_that_hold_keep_clear_and_no_more(small_checked_graph):
    """The base moves a little; the limbs are far from each other, and the clearance is as large."""
    rng, graph = np.random.default_rng(2), small_checked_graph

    def make():
        while True:
            s = int(rng.integers(len(graph)))
            points, turn = graph.points[s].tolist(), graph.base_rotation[s]
            first = graph.base_position[s]
            path = path_between((first, turn, first + rng.uniform(-0.05, 0.05, 3), turn))
            branches = graph.branch[s].tolist()
            try:
                joints = [
                    held_joints(graph, i, points[i], branches[i], path, SHARES) for i in (0, 1)
                ]
            except AssertionError:  # a limb cannot follow
                continue
            flanges = graph.solver.grasps["flange"][points]
            limbs = [
                holding(i, branches[i], flanges["position"][i], flanges["rotation"][i])
                for i in (0, 1)
            ]
            scratch = motion(path, (0.0, 1.0), *limbs, ("meeting",))
            return Case(scratch, moments_of(path, SHARES, *joints))

    carry_on(rng, make, False, 4, most=0.6)


@pytest.mark.parametrize("compared", ["boxes", "body", "resting"])
def test_a_departure_keeps_clear_and_no_more(small_checked_graph, compared):
    """A limb departs along the normal in a random stance; boxes behind the point are omitted."""
    rng, graph = np.random.default_rng(3), small_checked_graph

    def make():
        s = int(rng.integers(len(graph)))
        stance = graph.points[s].tolist()
        allowed = (
            [b for b in range(16) if branch_set >> b & 1]
            for branch_set in graph.branch_sets[s].tolist()
        )
        bits = [int(rng.choice(some)) for some in allowed]
        here = graph.configuration(State(tuple(stance), tuple(1 << bit for bit in bits)))
        at = graph.base_position[s], graph.base_rotation[s]
        grasp = grasps_of(graph, [(0, stance[0])])
        _, point, normal = grasp[0]
        # The flange's x axis lies along the rail and its z axis points into the surface.
        rail = graph.grasp_map.rotations[stance[0]][:, 0]
        turned = np.column_stack([rail, np.cross(-normal, rail), -normal])
        place, joints = point + ROBOT.tool_length * normal, np.empty((len(SHARES), 6))
        for q, height in zip(joints, ROBOT.lift * SHARES, strict=True):
            lifted = pose(place + height * normal, turned)
            assert called(angles_at)(SHAPES.limb, pose(*at), lifted, bits[0] & 7, 0.0, q)
        path, lift = path_between(at * 2), departing(0, bits[0] & 7, place, turned)
        scratch = motion(path, (0.0, 0.0), lift, lift, (compared,))
        let_rest(scratch, 1, in_body(1, [here[2][1]]))
        behind = scratch["surface"]
        behind["applies"], behind["point"], behind["normal"] = True, point, normal
        return Case(scratch, moments_of(path, 0.0 * SHARES, joints, here[2][1]), tuple(grasp))

    carry_on(rng, make, compared == "boxes", 6)


def test_no_thin_plate_is_skipped():
    """Long swings reported clear of plates of 1 mm are clear at every sample."""
    rng, clear = np.random.default_rng(4), 0
    for n in range(60):
        path, base = base_motion(rng, STRAIGHT)
        ours = knots(rng, 2.5)
        scratch = motion(path, (0.0, 1.0), swinging(0, ours[0], ours[2]), compared=("boxes",))
        places, joints = along(*base[:, None], False, FINE)[:, 0], along(*ours, False, FINE)
        moments = moments_of(path, places, joints, 0.0)
        case = Case(scratch, moments)
        plate = thin_box(rng, case, n % 2)
        if answer(scratch, 0.02, (plate,)) == CLEAR:
            clear += 1
            assert case.least(RULER.only(case.compared).among([plate]), 0.05)[0][0] >= 0.02 - 1e-9
    assert clear > 5


def test_joint_angles_at_a_corner_are_those_of_its_curve():
    rng = np.random.default_rng(0)
    knots = rng.normal(size=(3, 7))
    scratch, q = motion(REST, (0.0, 1.0), swinging(0, knots[0, 1:], knots[2, 1:])), np.zeros(6)
    round_corner(scratch, 0.5, knots[1, 1:])
    for t in np.linspace(0.0, 1.0, 9):
        assert called(set_joints)(SHAPES.robot, scratch["motion"]["first"], t, scratch, q)
        np.testing.assert_allclose(q, at_corner(*knots, np.array([t]))[0, 1:], atol=1e-12)
