"""Motions are called clear at 1.2 times the clearance and never at 0.8 times; coal is the ruler.

Obstacles are placed by construction: a motion is sampled densely, and a thin plate or rod is put in
front of the point that reaches farthest in some direction, so that its distance to the swept shapes
is known.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from coal_ruler import PLATE, ROD, Ruler, apart, capsule, grasps_of, in_front, solid
from limb_motions import (
    MOUNTS,
    NO_LIMBS,
    NOBODY,
    RADII,
    ROBOT,
    SHAPES,
    Hold,
    by_coal,
    draw,
    held_joints,
    in_body,
    least_apart,
    shift_to,
)
from scipy.spatial.transform import Rotation

from mlivr_gym import stance_graph
from mlivr_gym.collisions.collision_model import CollisionModel
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.swept_hold import MOVER, STANDING, holds_apart
from mlivr_gym.collisions.swept_swing import swing_free
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.kinematics.base_path import ARC, STRAIGHT
from mlivr_gym.kinematics.holding import base_path, quaternion
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.planners import Planner

CLEARANCE = 0.02
NEAR, FAR = 0.8 * CLEARANCE, 1.2 * CLEARANCE
EMPTY = CollisionModel(SHAPES, (), CLEARANCE).arrays


class Swing(NamedTuple):
    """A line in joint space of limb 0 while the base follows a path, or stands where it starts."""

    path: tuple
    last: float
    start: np.ndarray
    end: np.ndarray

    def moments(self, places):
        """Where the robot is at some places along the swing; limb 1 does not count."""
        where, turned = base_path(*self.path, places * self.last)
        own = self.start + places[:, None] * (self.end - self.start)
        joints = np.stack([own, np.zeros_like(own)], axis=1)
        return [(w, quaternion(r), q) for w, r, q in zip(where, turned, joints, strict=True)]

    def answer(self, box):
        """What the compiled check says, boxes alone."""
        shapes, _, _, fixed, world, clearance, body = CollisionModel(
            SHAPES, (box,), CLEARANCE
        ).arrays
        return swing_free(
            0, self.path, 0.0, self.last, self.start, self.end, ROBOT.limb.lengths, MOUNTS[0][0],
            MOUNTS[1][0], NO_LIMBS, shapes, fixed, world, clearance, False, body,
        )  # fmt: skip


CASES = (
    ("limb", 0.5, 0.1, 0.2), ("mount", 0.05, 0.01, 1.2), ("body", 0.05, 0.4, 0.2),
    ("limb", 0.0, 0.4, 0.0), ("limb", 0.0, 0.0, 0.8),
)  # fmt: skip
"""What reaches farthest, and how far joints turn [rad] and the base travels [m] and turns [rad]."""


def random_swing(rng, kind, joints, travel, swing):
    """A swing from a random place; the base follows a path of a kind, or stays if that is None."""
    start, turn = rng.uniform(-np.pi, np.pi, 6), Rotation.random(rng=rng)
    first, more = rng.uniform(-1.0, 1.0, 3), travel * draw(rng)
    after = (turn * Rotation.from_rotvec(swing * draw(rng))).as_matrix()
    pivot = first + rng.uniform(-0.3, 0.3, 3) + (0.0, 0.0, -0.8)
    path = (first, turn.as_matrix(), first + more, after, kind or STRAIGHT, pivot)
    return Swing(path, float(kind is not None), start, start + joints * rng.uniform(-1.0, 1.0, 6))


class Spheres(NamedTuple):
    """Spheres in which limb 0, mounts and body reach farthest in any direction, at k moments."""

    centres: np.ndarray  # (k, n, 3)
    radii: np.ndarray  # (n,)

    @classmethod
    def of(cls, moments, still=False, containing=False):
        """The body as its corners or, if `containing`, as the capsules that the checks take for it.

        Only the limb if `still`.
        """
        mounts, mount_radius, half, _ = SHAPES.fixed
        body, thick = np.array(list(product((-1.0, 1.0), repeat=3))) * half, 0.0
        if containing:
            body, thick = SHAPES.body[0][:4].reshape(-1, 3), SHAPES.body[1][0]
        fixed = np.zeros((0, 3)) if still else np.concatenate([mounts.reshape(-1, 3), body])
        centres = []
        for here in moments:
            base = Rotation.from_quat(here[1], scalar_first=True).as_matrix()
            limb = capsule_ends(ROBOT, SHAPES, here)[0].reshape(-1, 3)
            centres.append(np.concatenate([limb, here[0] + fixed @ base.T]))
        radii = np.concatenate(
            [np.repeat(RADII, 2), np.repeat(mount_radius, 2), np.full(len(body), thick)]
        )
        return cls(np.array(centres), radii[: centres[0].shape[0]])

    def farthest(self, direction):
        """Where they reach farthest in a direction: point, moment and kind of shape."""
        heights = self.centres @ direction + self.radii
        k, c = np.unravel_index(int(np.argmax(heights)), heights.shape)
        kind = "limb" if c < 14 else "mount" if c < 18 else "body"
        return self.centres[k, c] + self.radii[c] * direction, int(k), kind


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


def meeting(rng, kind, wanted, *motion):
    """A random swing and a direction in which the limb, a mount or the body reaches farthest."""
    places = np.linspace(0.0, 1.0, 151)
    while True:
        swing = random_swing(rng, kind, *motion)
        moments = swing.moments(places)
        exact = Spheres.of(moments, kind is None)
        for direction in (draw(rng) for _ in range(30)):
            point, k, shape = exact.farthest(direction)
            if shape == wanted:
                return swing, moments, direction, point, k


@pytest.mark.parametrize("kind", [None, STRAIGHT, ARC], ids=["rest", "straight", "arc"])
def test_a_swing_keeps_the_clearance_and_no_more(kind):
    """A thin obstacle before limb, mount or body, whichever reaches farthest in a swing."""
    rng, ruler, still = np.random.default_rng(0), Ruler(ROBOT), kind is None
    for n in range(12 if still else 20):
        case, half = CASES[0 if still else n % len(CASES)], (PLATE, ROD)[n % 2]
        swing, moments, direction, point, k = meeting(rng, kind, *case)
        near = in_front(point, direction, NEAR, half)
        least = moving(ruler.among([near]).measured(moments[k]), still)
        assert least == pytest.approx(NEAR, abs=1e-5)
        assert swing.answer(near) != CLEAR
        containing = Spheres.of(moments, still, True)
        far = in_front(containing.farthest(direction)[0], direction, FAR, half)
        ruler.among([far])
        assert min(moving(ruler.measured(here), still) for here in moments[::10]) > FAR - 1e-5
        assert swing.answer(far) == CLEAR


def test_a_limb_that_holds_keeps_the_clearance_to_boxes_and_no_more(small_checked_graph):
    """A thin obstacle before the arm that follows the base; its hand stands still."""
    rng = np.random.default_rng(1)
    for n in range(30):
        hold = Hold.random(small_checked_graph, rng)
        ends, direction = hold.world()[:, : SHAPES.hand], draw(rng)
        spheres = Spheres(ends.reshape(len(ends), -1, 3), np.repeat(RADII[: SHAPES.hand], 2))
        point, k, _ = spheres.farthest(direction)
        for gap in (NEAR, FAR):
            box = in_front(point, direction, gap, (PLATE, ROD)[n % 2])
            arm = [capsule(r, *axis) for r, axis in zip(RADII, ends[k], strict=False)]
            least = min(apart(shape, solid(box)) for shape in arm)
            assert least == pytest.approx(gap, abs=1e-5)
            collision_model = CollisionModel(SHAPES, (box,), CLEARANCE).arrays
            assert (hold.answer(collision_model, NOBODY, STANDING) == CLEAR) == (gap == FAR)


def test_a_limb_that_holds_keeps_the_clearance_to_the_one_that_swings_and_no_more(
    small_checked_graph,
):
    """The mover's mount is shifted until both limbs are 0.8 or 1.2 times the clearance apart."""
    rng, places = np.random.default_rng(2), np.linspace(0.0, 1.0, 151)
    for _ in range(6):
        hold = Hold.random(small_checked_graph, rng)
        mover = 1 - hold.limb
        start = rng.uniform(-np.pi, np.pi, 6)
        end = start + rng.uniform(-0.5, 0.5, 6)
        ours = in_body(hold.limb, hold.joints)
        theirs = in_body(mover, start + places[:, None] * (end - start))
        direction = draw(rng)
        for gap in (NEAR, FAR):
            offset = shift_to(ours, theirs, direction, gap)
            line = start, end, MOUNTS[0][mover], MOUNTS[1][mover] + offset
            assert (hold.answer(EMPTY, line, MOVER) == CLEAR) == (gap == FAR)


def test_a_line_through_a_limb_that_holds_is_not_clear(small_checked_graph):
    """Random lines of the mover: clear only where coal finds the clearance at every sample."""
    rng, places = np.random.default_rng(3), np.linspace(0.0, 1.0, 201)
    answers = []
    for _ in range(40):
        hold = Hold.random(small_checked_graph, rng, 201)
        mover = 1 - hold.limb
        start, end = rng.uniform(-2.0, 2.0, (2, 6))
        ours = in_body(hold.limb, hold.joints)
        theirs = in_body(mover, start + places[:, None] * (end - start))
        _, at = least_apart(ours, theirs)
        least = by_coal(ours, theirs, at)
        line = start, end, MOUNTS[0][mover], MOUNTS[1][mover]
        clear = hold.answer(EMPTY, line, MOVER) == CLEAR
        assert not clear or least >= CLEARANCE - 1e-9
        assert clear or least < 2.0 * CLEARANCE
        answers.append(clear)
    assert 5 < sum(answers) < 35


def both_hold(graph, rng):
    """Two limbs that hold while the base moves a little without turning.

    Their joint angles, branches, path and points.
    """
    while True:
        s = int(rng.integers(len(graph)))
        points, turn = graph.points[s].tolist(), graph.rotation[s]
        path = (
            graph.position[s],
            turn,
            graph.position[s] + 0.08 * draw(rng),
            turn,
            STRAIGHT,
            np.zeros(3),
        )
        branches = graph.branch[s].tolist()
        try:
            joints = [held_joints(graph, i, points[i], branches[i], path, 101) for i in range(2)]
        except AssertionError:
            continue
        return joints, branches, path, points


def apart_answer(graph, branches, path, points, offset=(0.0, 0.0, 0.0)):
    """`holds_apart`, the second limb's mount and grip shifted by an offset in the body frame."""
    grips, tools = graph.solver.flanges[points].copy(), graph.solver.tools[points]
    grips[1] += path[1] @ offset
    places = MOUNTS[1].copy()
    places[1] += offset
    limbs = [(grips[i], tools[i], branches[i], MOUNTS[0][i], places[i]) for i in range(2)]
    return holds_apart(*limbs[0], *limbs[1], path, ROBOT.limb.lengths, SHAPES.arrays, CLEARANCE)


def test_two_limbs_that_hold_keep_the_clearance_and_no_more(small_checked_graph):
    """The second limb is shifted until they are 0.8 or 1.2 times the clearance apart."""
    rng, graph = np.random.default_rng(4), small_checked_graph
    for _ in range(6):
        joints, branches, path, points = both_hold(graph, rng)
        first, second = (in_body(i, joints[i]) for i in range(2))
        direction = draw(rng)
        for gap in (NEAR, FAR):
            offset = shift_to(first, second, direction, gap)
            assert (apart_answer(graph, branches, path, points, offset) == CLEAR) == (gap == FAR)


def nearest(graph, plan, ruler, samples):
    """Distances at samples of a plan's steps, grippers at grasps left out, the least first."""
    found = []
    for k, step in enumerate(plan.steps):
        motion = step_motion(graph, plan, k, samples)
        before, after = (graph.indices(plan.stances[n]) for n in (k, k + 1))
        for n, phase in enumerate(motion.phase):
            points = [(i, p) for i, p in enumerate(before) if i != step.limb]
            # It departs along one normal and approaches along the other; between it is at no grasp.
            points += {
                0: [(step.limb, before[step.limb])],
                1: [],
                2: [(step.limb, after[step.limb])],
            }[int(phase)]
            here = motion.base_positions[n], motion.base_quaternions[n], motion.joint_positions[n]
            found += ruler.measured(here, grasps_of(graph, points), 2.0 * CLEARANCE)
    return sorted(found)


@pytest.mark.parametrize(("robot", "plans"), [("mlivr2", 10), ("mlivr3", 2)])
def test_all_along_plans_coal_finds_the_clearance(jem, checked_graph, robot, plans):
    """Between all shapes that are compared, at every sample of every step."""
    graph = checked_graph if robot == "mlivr2" else stance_graph(jem, robot)
    rng, ruler, planner = np.random.default_rng(5), Ruler(graph.robot, jem.boxes), Planner(graph)
    found = []
    for n in range(plans):
        start, goal = sample_task(graph, rng, 1.0)
        cost = ("base", "steps")[n % 2] if graph.limbs == 2 else "weighted"
        price = {} if graph.limbs == 2 else {"regrasp_price": 0.2}
        plan = planner.plan(start.stance, goal, cost, **price).unwrap()
        found += nearest(graph, plan, ruler, 12)
    assert min(found)[0] >= CLEARANCE - 1e-9
    # They come so near that the clearance decides.
    ids = {box.id for box in jem.boxes}
    assert min(gap for gap, _, other in found if other in ids) < 1.5 * CLEARANCE
    if robot == "mlivr3":
        between = [gap for gap, a, b in found if {a[:4], b[:4]} == {"limb"} and a[:5] != b[:5]]
        assert min(between) < 2.0 * CLEARANCE
