"""Swings and departures are called clear at 1.2 times the clearance and never at 0.8 times.

Coal is the ruler. Obstacles are placed by construction: a motion is sampled densely, and a thin
plate or rod is put in front of the point that reaches farthest in some direction, so that its
distance to the swept shapes is known. For the shapes of the robot itself the least distance on a
motion is measured, and the motion checked with a clearance a quarter above it and a sixth below.
"""

from collections import Counter
from typing import NamedTuple

import numpy as np
import pytest
from coal_ruler import PLATE, ROD, Ruler, apart, capsule, grasps_of, in_front, solid
from compiled import called
from held_paths import path_between
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from limb_motions import (
    AT_ORIGIN,
    HAND,
    RADII,
    REST,
    ROBOT,
    SHAPES,
    Limb,
    Spheres,
    answer,
    at_corner,
    departing,
    draw,
    in_body,
    kind_of,
    let_rest,
    motion,
    round_corner,
    shift_to,
    swinging,
    verdicts,
)
from scipy.spatial.transform import Rotation

from mlivr_gym import Box
from mlivr_gym.collisions.contacts import capsule_ends, contacts
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT, base_poses
from mlivr_gym.kinematics.limb import angles_at
from mlivr_gym.kinematics.poses import pose, quaternion
from mlivr_gym.transitions.state import State

CLEARANCE = 0.02


NEAR, FAR = 0.8 * CLEARANCE, 1.2 * CLEARANCE


SPLINTER = (0.0005, 0.01, 0.0005)


EVERYTHING = ("boxes", "body", "resting")


def swing_check(start, end, others=()):
    """The check of a line of limb 0 while the base rests, given a clearance.

    On each of some branches limb 1 rests: ends of its capsules, shape (k, c, 2, 3).
    """
    room = motion(REST, (0.0, 0.0), swinging(0, start, end), compared=EVERYTHING)
    let_rest(room, 1, others)
    return lambda clearance: answer(room, clearance)


def test_a_swing_keeps_clear_of_the_robot_itself_and_no_more():
    """Lines that come nearest to the body, to a mount, and to arm and hand of the limb itself."""
    rng, limb, met = np.random.default_rng(0), Limb(), Counter()
    share = np.linspace(0.0, 1.0, 61)[:, None]
    while min(met[name] for name in ("body", "mount", "arm", "hand")) < 1:
        start = rng.uniform(-np.pi, np.pi, 6)
        end = start + rng.uniform(-0.3, 0.3, 6)
        lines = [(*AT_ORIGIN, np.array([q, np.zeros(6)])) for q in start + share * (end - start)]
        gap, other = limb.nearest(lines[30:31])
        if not 0.01 < gap < 0.1 or met[kind_of(other)] == 2:
            continue
        gap, other = limb.nearest(lines)
        if 0.01 < gap < 0.1:
            met[kind_of(other)] += 1
            assert verdicts(swing_check(start, end), gap) == [False, True]


def test_a_swing_keeps_clear_of_a_limb_at_rest_and_no_more():
    """On each of three branches on which that may be; it is shifted to where it is met."""
    rng, share, met = np.random.default_rng(1), np.linspace(0.0, 1.0, 101)[:, None], 0
    while met < 8:
        start, rest = rng.uniform(-np.pi, np.pi, (2, 6))
        end = start + rng.uniform(-0.6, 0.6, 6)
        if swing_check(start, end)(CLEARANCE) != CLEAR:
            continue
        met += 1
        ours, theirs, direction = (
            in_body(0, start + share * (end - start)),
            in_body(1, [rest]),
            draw(rng),
        )
        for gap in (0.8 * CLEARANCE, 1.2 * CLEARANCE):
            branches = np.repeat(theirs + 9.0, 3, axis=0)
            shift = shift_to(ours, np.repeat(theirs, 101, axis=0), direction, gap)
            branches[rng.integers(3)] = theirs[0] + shift
            found = swing_check(start, end, branches)(CLEARANCE)
            assert (found == CLEAR) == (gap > CLEARANCE)


class Departure:
    """Limb 0 lifts off a point along the surface normal, from a random stance of a graph."""

    def __init__(self, graph, rng, samples=41):
        s = int(rng.integers(len(graph)))
        stance = graph.points[s].tolist()
        allowed = ([b for b in range(16) if mask >> b & 1] for mask in graph.mask[s].tolist())
        bits = [int(rng.choice(some)) for some in allowed]
        here = graph.configuration(State(tuple(stance), tuple(1 << bit for bit in bits)))
        branch, self.grasps = bits[0] & 7, grasps_of(graph, enumerate(stance))
        at = graph.base_in_world[s], graph.base_axes_in_world[s]
        _, point, normal = self.grasps[0]
        # The flange's x axis lies along the rail and its z axis points into the surface.
        rail = graph.grasp_map.rotations[stance[0]][:, 0]
        turned = np.column_stack([rail, np.cross(-normal, rail), -normal])
        place = point + ROBOT.tool_length * normal
        self.path, self.moves = path_between(at * 2), departing(0, branch, place, turned)
        self.joints = np.empty((samples, 6))
        for q, height in zip(self.joints, np.linspace(0.0, ROBOT.lift, samples), strict=True):
            lifted = pose(place + height * normal, turned)
            assert called(angles_at)(SHAPES.limb, pose(*at), lifted, branch, 0.0, q)
        self.moments = [(*here[:2], np.array([q, here[2][1]])) for q in self.joints]

    def others(self, offset=(0.0, 0.0, 0.0)):
        """Capsule ends of limb 1, shifted."""
        return in_body(1, [self.moments[0][2][1]]) + np.array(offset)

    def check(self, others=(), compared=EVERYTHING):
        """The compiled check, given a clearance and boxes; limb 1 rests as in `swing_check`."""
        room = motion(self.path, (0.0, 0.0), self.moves, self.moves, compared)
        let_rest(room, 1, others)
        behind = room["behind"]
        behind["applies"], (_, behind["point"], behind["normal"]) = True, self.grasps[0]
        return lambda clearance, boxes=(): answer(room, clearance, boxes)


def test_a_departure_keeps_clear_of_the_robot_and_no_more(small_checked_graph):
    """Of the limb itself, and of the other limb at rest, which is shifted to where it is met."""
    rng, limb = np.random.default_rng(2), Limb()
    for n in range(16):
        lift = Departure(small_checked_graph, rng)
        gap, _ = limb.nearest(lift.moments)
        if gap < 0.01:  # a branch on which the limb can hold, but not depart
            assert lift.check()(CLEARANCE) != CLEAR
            continue
        assert verdicts(lift.check(), gap) == [False, True]
        if n < 5:
            ours, direction = in_body(0, lift.joints), draw(rng)
            for gap in (0.8 * CLEARANCE, 1.2 * CLEARANCE):
                offset = shift_to(ours, np.repeat(lift.others(), len(ours), axis=0), direction, gap)
                found = lift.check(lift.others(offset))(CLEARANCE)
                assert (found == CLEAR) == (gap > CLEARANCE)


def test_a_departure_keeps_clear_of_boxes_and_no_more(small_checked_graph):
    """Of a plate before the capsule that reaches farthest, and of a splinter before the hand."""
    rng, hand = np.random.default_rng(3), 0
    for n in range(40):
        lift = Departure(small_checked_graph, rng)
        ends = np.array([capsule_ends(ROBOT, SHAPES, here)[0] for here in lift.moments])
        first, half = ((0, PLATE), (HAND, SPLINTER))[n % 2]
        direction, normal = draw(rng), lift.grasps[0][2]
        # Boxes behind the surface do not count for a gripper.
        direction -= min(2.0 * direction @ normal, 0.0) * normal
        heights = ends[:, first:] @ direction + RADII[first:, None]
        k, c, e = np.unravel_index(int(np.argmax(heights)), heights.shape)
        point = ends[k, first + c, e] + RADII[first + c] * direction
        boxes = [in_front(point, direction, share * CLEARANCE, half) for share in (0.8, 1.2)]
        gap = apart(capsule(RADII[first + c], *ends[k, first + c]), solid(boxes[0]))
        assert gap == pytest.approx(0.8 * CLEARANCE, abs=1e-5)
        check = lift.check(compared=("boxes",))
        assert check(CLEARANCE, boxes[:1]) != CLEAR
        everywhere = ((r, axis) for limb in ends for r, axis in zip(RADII, limb, strict=True))
        least = min(apart(capsule(r, *axis), solid(boxes[1])) for r, axis in everywhere)
        if least > 1.2 * CLEARANCE - 1e-5:
            hand += n % 2
            assert check(CLEARANCE, boxes[1:]) == CLEAR
    assert hand > 5


class Swing(NamedTuple):
    """A line in joint space of limb 0 while the base follows a path, or stands where it starts.

    Or, with a corner, base parameter and joint angles (7,), the rounding of that.
    """

    path: object
    last: float
    start: np.ndarray
    end: np.ndarray
    corner: np.ndarray | None = None

    def moments(self, places):
        """Where the robot is at some places along the swing; limb 1 does not count."""
        ends = np.array([[0.0, *self.start], [self.last, *self.end]])
        values = ends[0] + places[:, None] * (ends[1] - ends[0])
        if self.corner is not None:
            values = at_corner(ends[0], self.corner, ends[1], places)
        where, turned = base_poses(self.path, values[:, 0])
        moving_limb = values[:, 1:]
        joints = np.stack([moving_limb, np.zeros_like(moving_limb)], axis=1)
        return [(w, quaternion(r), q) for w, r, q in zip(where, turned, joints, strict=True)]

    def answer(self, box):
        """What the compiled check says, boxes alone."""
        line = swinging(0, self.start, self.end)
        room = motion(self.path, (0.0, self.last), line, compared=("boxes",))
        if self.corner is not None:
            round_corner(room, self.corner[0], self.corner[1:])
        return answer(room, CLEARANCE, (box,))


CASES = (
    ("limb", 0.5, 0.1, 0.2), ("mount", 0.05, 0.01, 1.2), ("body", 0.05, 0.4, 0.2),
    ("limb", 0.0, 0.4, 0.0), ("limb", 0.0, 0.0, 0.8),
)  # fmt: skip
"""What reaches farthest, and how far joints turn [rad] and the base travels [m] and turns [rad]."""


def random_swing(rng, kind, rounded, joints, travel, swing):
    """A swing from a random place; the base follows a path of a kind, or stays if that is None.

    In a line or, if `rounded`, round a corner at which the base is anywhere on its path.
    """
    start, turn = rng.uniform(-np.pi, np.pi, 6), Rotation.random(rng=rng)
    first, more = rng.uniform(-1.0, 1.0, 3), travel * draw(rng)
    after = (turn * Rotation.from_rotvec(swing * draw(rng))).as_matrix()
    pivot = first + rng.uniform(-0.3, 0.3, 3) + (0.0, 0.0, -0.8)
    ends = first, turn.as_matrix(), first + more, after
    path, last = path_between(ends, kind or STRAIGHT, pivot), float(kind is not None)
    end, corner = start + joints * rng.uniform(-1.0, 1.0, 6), None
    if rounded:
        corner = np.array([last * rng.uniform(), *(start + joints * rng.uniform(-1.0, 1.0, 6))])
    return Swing(path, last, start, end, corner)


def moving(measured, still):
    """Least distance of the thin box from what moves in a swing of limb 0 [m].

    `still` if the base is at rest.
    """
    distances = [1.0]
    for gap, name, other in measured:
        fixed = name == "body" or "/base/" in name
        if other == "thin" and (name.startswith("limb0/") or fixed) and not (still and fixed):
            distances.append(gap)
    return min(distances)


def meeting(rng, kind, rounded, wanted, *motion):
    """A random swing and a direction in which the limb, a mount or the body reaches farthest."""
    places = np.linspace(0.0, 1.0, 151)
    while True:
        swing = random_swing(rng, kind, rounded, *motion)
        moments = swing.moments(places)
        exact = Spheres.of(moments, kind is None)
        for direction in (draw(rng) for _ in range(30)):
            point, k, shape = exact.farthest(direction)
            if shape == wanted:
                return swing, moments, direction, point, k


@pytest.mark.parametrize("rounded", [False, True], ids=["line", "corner"])
@pytest.mark.parametrize("kind", [None, STRAIGHT, ARC], ids=["rest", "straight", "arc"])
def test_a_swing_keeps_the_clearance_and_no_more(kind, rounded):
    """A thin obstacle before limb, mount or body, whichever reaches farthest in a swing."""
    rng, ruler, still = np.random.default_rng(0), Ruler(ROBOT), kind is None
    for n in range(12 if still else 20):
        case, half = CASES[0 if still else n % len(CASES)], (PLATE, ROD)[n % 2]
        swing, moments, direction, point, k = meeting(rng, kind, rounded, *case)
        close = in_front(point, direction, NEAR, half)
        least = moving(ruler.among([close]).measured(moments[k]), still)
        assert least == pytest.approx(NEAR, abs=1e-5)
        assert swing.answer(close) != CLEAR
        containing = Spheres.of(moments, still, True)
        far = in_front(containing.farthest(direction)[0], direction, FAR, half)
        ruler.among([far])
        assert min(moving(ruler.measured(here), still) for here in moments[::10]) > FAR - 1e-5
        assert swing.answer(far) == CLEAR


def vectors(low=-1.0, high=1.0):
    return st.lists(st.floats(low, high), min_size=3, max_size=3).map(np.array)


angles = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6).map(np.array)


@given(angles, angles, vectors(-0.9, 0.9), st.floats(0.0005, 0.05))
@examples(max_examples=100, deadline=None)
def test_no_thin_plate_is_skipped(q0, q1, centre, half):
    """A swing called clear of a plate of a millimetre keeps its clearance at many samples."""
    plate = Box("plate", "obstacle", tuple(centre), (0.2, half, 0.2))
    ends = (
        np.zeros(3),
        np.eye(3),
        np.array([0.3, 0.1, -0.2]),
        Rotation.from_rotvec([0.3, -0.2, 0.4]).as_matrix(),
    )
    path = path_between(ends)
    room = motion(path, (0.0, 1.0), swinging(0, q0, q1), compared=EVERYTHING)
    if answer(room, 0.02, (plate,)) != CLEAR:
        return
    where, turned = base_poses(path, np.linspace(0.0, 1.0, 80))
    for k, s in enumerate(np.linspace(0.0, 1.0, 80)):
        joints = np.array([q0 + s * (q1 - q0), np.zeros(6)])
        found = contacts(ROBOT, (plate,), (where[k], quaternion(turned[k]), joints), 0.02)
        counted = [
            c for c in found if c.first.startswith("limb0") and c.second[:6] not in ("limb1/",)
        ]
        assert all(c.distance >= 0.02 - 1e-9 for c in counted)
