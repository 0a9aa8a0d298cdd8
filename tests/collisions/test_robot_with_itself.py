"""Stances, departures and swings keep the robot's shapes apart from each other; coal is the ruler.

The least distance on a motion is measured, and the motion checked with a clearance a quarter above
it and a sixth below it: never clear with the first, clear with the second.
"""

from collections import Counter

import numpy as np
import pytest
from coal_ruler import PLATE, Ruler, apart, capsule, grasps_of, in_front, solid
from limb_motions import (
    MOUNTS,
    NO_LIMBS,
    NOBODY,
    RADII,
    ROBOT,
    SHAPES,
    Hold,
    draw,
    in_body,
    shift_to,
)

from mlivr_gym.collisions.collision_model import CollisionModel
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.swept_hold import STANDING
from mlivr_gym.collisions.swept_swing import departure_free, swing_free
from mlivr_gym.kinematics.base_path import STRAIGHT
from mlivr_gym.kinematics.ur import branch_angles
from mlivr_gym.stances.stance_graph import State
from mlivr_gym.transitions.grasp_poses import flange_at

CLEARANCE = 0.02
SPLINTER = (0.0005, 0.01, 0.0005)
AT_ORIGIN = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
REST = (np.zeros(3), np.eye(3), np.zeros(3), np.eye(3), STRAIGHT, np.zeros(3))


def verdicts(check, least):
    """Whether a motion is called clear whose least distance is 0.8 and 1.2 times the clearance."""
    return [
        check(CollisionModel(SHAPES, (), least / share).arrays) == CLEAR for share in (0.8, 1.2)
    ]


class Limb:
    """Distances of limb 0 from its own links, body and mounts and, if wanted, from others."""

    def __init__(self, other=False, boxes=()):
        self.ruler = Ruler(ROBOT, boxes)
        names = self.ruler.shapes

        def counts(*pair):
            there = [names[g] for g in pair]
            moving = [name for name in there if name.startswith("limb0/") and "/base/" not in name]
            apart = [name for name in there if name.startswith("limb1/") and "/base/" not in name]
            return moving and (other or not apart)

        self.ruler.pairs = [pair for pair in self.ruler.pairs if counts(*pair)]

    def nearest(self, configurations, grasps=()):
        """Least distance over some configurations, below 0.5 m, and what limb 0 is nearest to."""
        best = (0.5, "")
        for here in configurations:
            for gap, first, second in self.ruler.measured(here, grasps, best[0]):
                own = first if first.startswith("limb0/") and "/base/" not in first else second
                if own.startswith("limb0/") and "/base/" not in own:
                    best = min(best, (gap, second if own == first else first))
        return best


def kind(name):
    """Body, a mount, another limb, or the hand or the arm of limb 0 itself."""
    if "/base/" in name or not name.startswith("limb0/"):
        return "mount" if "/base/" in name else name.split("/")[0]
    return "arm" if name.split("/")[1] in ("shoulder", "upper_arm", "forearm") else "hand"


def swing_check(start, end, others):
    """The check of a line of limb 0 while the base rests, as a function of `Bodies.arrays`."""

    def check(collision_model):
        shapes, _, _, fixed, world, clearance, body = collision_model
        return swing_free(
            0, REST, 0.0, 0.0, start, end, ROBOT.limb.lengths, MOUNTS[0][0], MOUNTS[1][0], others,
            shapes, fixed, world, clearance, True, body,
        )  # fmt: skip

    return check


def test_a_swing_keeps_clear_of_the_robots_own_shapes_and_no_more():
    """Lines that come nearest to the body, to a mount, and to the limb's own arm and hand."""
    rng, limb, met = np.random.default_rng(0), Limb(), Counter()
    share = np.linspace(0.0, 1.0, 61)[:, None]
    while min(met[name] for name in ("body", "mount", "arm", "hand")) < 1:
        start = rng.uniform(-np.pi, np.pi, 6)
        end = start + rng.uniform(-0.3, 0.3, 6)
        lines = [(*AT_ORIGIN, np.array([q, np.zeros(6)])) for q in start + share * (end - start)]
        gap, other = limb.nearest(lines[30:31])
        if not 0.01 < gap < 0.1 or met[kind(other)] == 5:
            continue
        gap, other = limb.nearest(lines)
        if 0.01 < gap < 0.1:
            met[kind(other)] += 1
            assert verdicts(swing_check(start, end, NO_LIMBS), gap) == [False, True]


def test_a_swing_keeps_clear_of_a_limb_at_rest_and_no_more():
    """On each of three branches on which that may be; it is shifted to where it is met."""
    rng, share, met = np.random.default_rng(1), np.linspace(0.0, 1.0, 101)[:, None], 0
    while met < 8:
        start, rest = rng.uniform(-np.pi, np.pi, (2, 6))
        end = start + rng.uniform(-0.6, 0.6, 6)
        if swing_check(start, end, NO_LIMBS)(CollisionModel(SHAPES, (), CLEARANCE).arrays) != CLEAR:
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
            answer = swing_check(start, end, branches)(CollisionModel(SHAPES, (), CLEARANCE).arrays)
            assert (answer == CLEAR) == (gap > CLEARANCE)


def test_a_limb_that_holds_keeps_clear_of_the_robot_and_no_more(small_checked_graph):
    """Of its own links, the body and the mounts, while the base follows a path."""
    rng, limb, met = np.random.default_rng(4), Limb(), Counter()
    while sum(met.values()) < 20:
        hold = Hold.random(small_checked_graph, rng, 61)
        if hold.limb == 0:
            moments = [(*AT_ORIGIN, np.array([q, np.zeros(6)])) for q in hold.joints]
            gap, other = limb.nearest(moments)
            met[kind(other)] += 1
            answers = verdicts(
                lambda collision_model, h=hold: h.answer(collision_model, NOBODY, STANDING), gap
            )
            assert answers == [False, True]
    assert len(met) > 1


class Departure:
    """Limb 0 lifts off a point along the surface normal, from a random stance of a graph."""

    def __init__(self, graph, rng, samples=41):
        s = int(rng.integers(len(graph)))
        stance, solver = graph.points[s].tolist(), graph.solver
        allowed = ([b for b in range(16) if mask >> b & 1] for mask in graph.mask[s].tolist())
        bits = [int(rng.choice(some)) for some in allowed]
        here = graph.configuration(State(tuple(stance), tuple(1 << bit for bit in bits)))
        self.base, self.branch, self.grasps = (
            here[:2],
            bits[0] & 7,
            grasps_of(graph, enumerate(stance)),
        )
        self.pose, self.at = [np.empty(3) for _ in range(4)], (graph.position[s], graph.rotation[s])
        mount = MOUNTS[0][0], MOUNTS[1][0]
        flange_at(
            *self.grasps[0][1:],
            solver.rails[stance[0]],
            ROBOT.tool_length,
            *self.at,
            *mount,
            *self.pose,
        )
        p, x, z, away = self.pose
        self.joints = np.empty((samples, 6))
        for q, height in zip(self.joints, np.linspace(0.0, ROBOT.lift, samples), strict=True):
            assert branch_angles(p + height * away, x, z, ROBOT.limb.lengths, self.branch, q)
        self.moments = [(*self.base, np.array([q, here[2][1]])) for q in self.joints]

    def others(self, offset=(0.0, 0.0, 0.0)):
        """Capsule ends of limb 1, shifted."""
        return in_body(1, [self.moments[0][2][1]]) + np.array(offset)

    def check(self, others, inside=True):
        """The compiled check, as a function of `Bodies.arrays`."""

        def check(collision_model):
            shapes, gripper, _, fixed, world, clearance, _ = collision_model
            return departure_free(
                0, *self.pose, ROBOT.lift, ROBOT.limb.lengths, self.branch, MOUNTS[0][0],
                MOUNTS[1][0], *self.at, others, shapes, gripper, fixed, world, *self.grasps[0][1:],
                clearance, inside,
            )  # fmt: skip

        return check


def test_a_departure_keeps_clear_of_the_robot_and_no_more(small_checked_graph):
    """Of its own shapes, and of the other limb at rest, which is shifted to where it is met."""
    rng, limb = np.random.default_rng(2), Limb()
    for n in range(16):
        lift = Departure(small_checked_graph, rng)
        gap, _ = limb.nearest(lift.moments)
        assert verdicts(lift.check(NO_LIMBS), gap) == [False, True]
        if n < 5:
            ours, direction = in_body(0, lift.joints), draw(rng)
            for gap in (0.8 * CLEARANCE, 1.2 * CLEARANCE):
                offset = shift_to(ours, np.repeat(lift.others(), len(ours), axis=0), direction, gap)
                answer = lift.check(lift.others(offset))(
                    CollisionModel(SHAPES, (), CLEARANCE).arrays
                )
                assert (answer == CLEAR) == (gap > CLEARANCE)


def test_a_departure_keeps_clear_of_boxes_and_no_more(small_checked_graph):
    """Of a plate before the capsule that reaches farthest, and of a splinter before the hand."""
    rng, hand = np.random.default_rng(3), 0
    for n in range(40):
        lift = Departure(small_checked_graph, rng)
        ends = np.array([capsule_ends(ROBOT, SHAPES, here)[0] for here in lift.moments])
        first, half = ((0, PLATE), (SHAPES.hand, SPLINTER))[n % 2]
        direction, normal = draw(rng), lift.grasps[0][2]
        # Boxes behind the surface do not count for a gripper.
        direction -= min(2.0 * direction @ normal, 0.0) * normal
        heights = ends[:, first:] @ direction + RADII[first:, None]
        k, c, e = np.unravel_index(int(np.argmax(heights)), heights.shape)
        point = ends[k, first + c, e] + RADII[first + c] * direction
        boxes = [in_front(point, direction, share * CLEARANCE, half) for share in (0.8, 1.2)]
        near = apart(capsule(RADII[first + c], *ends[k, first + c]), solid(boxes[0]))
        assert near == pytest.approx(0.8 * CLEARANCE, abs=1e-5)
        assert (
            lift.check(NO_LIMBS, False)(CollisionModel(SHAPES, boxes[:1], CLEARANCE).arrays)
            != CLEAR
        )
        everywhere = ((r, axis) for limb in ends for r, axis in zip(RADII, limb, strict=True))
        least = min(apart(capsule(r, *axis), solid(boxes[1])) for r, axis in everywhere)
        if least > 1.2 * CLEARANCE - 1e-5:
            hand += n % 2
            assert (
                lift.check(NO_LIMBS, False)(CollisionModel(SHAPES, boxes[1:], CLEARANCE).arrays)
                == CLEAR
            )
    assert hand > 5


def test_free_stances_keep_the_clearance(checked_graph, jem):
    """All shapes that are compared, on random ones of the branches allowed."""
    graph, rng, ruler = checked_graph, np.random.default_rng(3), Ruler(ROBOT, jem.boxes)
    found = []
    for s in rng.choice(len(graph), 500, replace=False):
        stance = tuple(graph.points[s].tolist())
        allowed = ([b for b in range(16) if mask >> b & 1] for mask in graph.mask[s].tolist())
        bits = tuple(1 << int(rng.choice(some)) for some in allowed)
        here = graph.configuration(State(stance, bits))
        found += ruler.measured(here, grasps_of(graph, enumerate(stance)), 0.05)
    assert CLEARANCE - 1e-9 <= min(found)[0] < 1.1 * CLEARANCE
