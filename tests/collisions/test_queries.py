"""Stances and plans among boxes and obstacles touch nothing, as measured by Coal."""

from dataclasses import replace

import numpy as np
import pytest
from coal_ruler import Ruler, grasps_of, obstacles, sampled
from scipy.spatial.transform import Rotation
from wrist_arms import iiwa_from_file

from mlivr_gym import Box, Capsule, robot_spec, stance_graph
from mlivr_gym.collisions.contacts import box_distances
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner
from mlivr_gym.transitions.state import State

CLEARANCE = 0.02
ROBOT = robot_spec("mlivr2")


def rod(centre, axes, thickness, length):
    """Return a rod along the third of given axes, the columns of a rotation."""
    half = (0.5 * thickness, 0.5 * thickness, 0.5 * length)
    return Box("rod", "obstacle", tuple(centre), half, Box.rows(axes))


def configuration(graph, s, rng):
    """Return a configuration of a stance on random branches of its branch set, and these
    branches."""
    bits = ([b for b in range(16) if m >> b & 1] for m in graph.branch_sets[s].tolist())
    branch_sets = tuple(1 << int(rng.choice(some)) for some in bits)
    return graph.configuration(State(tuple(graph.points[s].tolist()), branch_sets)), branch_sets


def test_capsules_that_reach_far_out_meet_far_obstacles(ladder):
    """An obstacle counts wherever a robot's shapes reach."""
    mast = Capsule("base", (0.0, 0.0, 0.05), (2.5, 0.0, 0.05), 0.03)
    robot = replace(ROBOT, name="mast", capsules=(*ROBOT.mounted[0].capsules, mast))
    graph, rng = stance_graph(ladder, robot), np.random.default_rng(3)
    here, _ = configuration(graph, 0, rng)
    tip = here[0] + graph.base_rotation[0] @ (
        robot.mount_positions[0] + robot.mount_rotations[0] @ np.array([2.45, 0.0, 0.05])
    )  # fmt: skip
    with obstacles(graph, rod(tip, np.eye(3), 0.01, 0.01)):
        assert not graph.branch_sets[0].all()
    assert np.linalg.norm(tip - here[0]) < robot.extent


@pytest.mark.parametrize(("height", "held"), [(0.001, True), (0.004, False)])
def test_only_what_is_flush_with_a_surface_lies_behind_a_grasp(small_checked_graph, height, held):
    """A block under the gripper protrudes by 1 mm, or by 4 mm."""
    graph, rng = small_checked_graph, np.random.default_rng(3)
    for point in rng.choice(np.unique(graph.points), 10, replace=False).tolist():
        turn, middle = graph.grasp_map.rotations[point], graph.solver.grasps["point"][point]
        middle = middle + (height - 0.01) * graph.solver.grasps["normal"][point]
        block = Box("block", "obstacle", tuple(middle), (0.02, 0.02, 0.01), Box.rows(turn))
        here = (graph.points == point).any(axis=1)
        before = graph.branch_sets[here].copy()
        with obstacles(graph, block):
            after = graph.branch_sets[here].copy()
        assert np.array_equal(before, after) if held else not after.all(axis=1).any()


def close_to(graph, s, limb, branch, box):
    """Yield limb (-1 for the body) and link of shapes near a box, a limb on a given branch.

    Each comes with its distance [m].
    """
    stance = tuple(graph.points[s].tolist())
    bits = [1 << int(branch_sets).bit_length() - 1 for branch_sets in graph.branch_sets[s]]
    bits[limb] = 1 << branch
    here = graph.configuration(State(stance, tuple(bits)))
    grasps = grasps_of(graph, enumerate(stance))
    for name, _, away in box_distances(ROBOT, (box,), here, CLEARANCE + 0.03, grasps):
        parts = name.split("/")
        yield (int(parts[0][4:]), parts[1], away) if len(parts) > 1 else (-1, "body", away)


def test_a_rod_takes_away_the_branches_that_touch_it_and_no_other(small_checked_graph):
    """Compare with the plain definition by branch; a touched base or gripper removes all branches.

    Compiled code uses a larger body: within 3 cm more of it, all branches may be removed.
    """
    graph, rng, shapes = small_checked_graph, np.random.default_rng(6), LimbShapes(ROBOT)
    on_axis = shapes.names[int(shapes.limb["first_on_axis"]) :]
    some = all_gone = 0
    for _ in range(100):
        s, limb = int(rng.integers(len(graph))), int(rng.integers(2))
        (base, *_), before = configuration(graph, s, rng)[0], graph.branch_sets[s].tolist()
        reached = graph.grasp_map.positions[graph.points[s, limb]] - base
        place = base + rng.uniform(0.3, 1.0) * reached + rng.normal(size=3) * 0.12
        box = rod(place, Rotation.random(None, rng).as_matrix(), 0.03, rng.uniform(0.02, 0.2))
        expected, whole, about = list(before), False, False
        for i, b in ((i, b) for i in (0, 1) for b in range(8) if before[i] & 0x101 << b):
            near = list(close_to(graph, s, i, b, box))
            found = {(k, link) for k, link, away in near if away < CLEARANCE}
            if any(k == i and link != "base" for k, link in found):
                expected[i] &= ~(0x101 << b)
            whole |= any(link in ("body", "base", *on_axis) for _, link in found)
            about |= any(
                link in ("body", "base") for _, link, away in near if away < CLEARANCE + 0.03
            )
        with obstacles(graph, box):
            after = graph.branch_sets[s].tolist()
        expected = expected if all(expected) else [0, 0]
        assert after == ([0, 0] if whole else expected) or (about and after == [0, 0])
        some += after == expected != before
        all_gone += whole
    assert some > 10
    assert all_gone > 2


@pytest.mark.parametrize(("robot", "plans"), [("mlivr2", 5), ("mlivr3", 12), ("two iiwa", 3)])
def test_all_along_plans_coal_finds_the_clearance(jem, checked_graph, robot, plans):
    """All shapes that are compared keep the clearance at every sample of every step.

    Two iiwas, for which no table ships, walk on every third point.
    """
    graph = checked_graph
    if robot == "two iiwa":
        some = jem.subset(np.arange(len(jem)) % 3 == 0, "some")
        graph = stance_graph(some, iiwa_from_file(0.8))
    elif robot != "mlivr2":
        graph = stance_graph(jem, robot)
    rng, ruler, planner = np.random.default_rng(5), Ruler(graph.robot, jem.boxes), Planner(graph)
    found = []
    for n in range(plans):
        start, goal = sample_task(graph, rng, 0.7)
        cost = ("base", "steps")[n % 2] if graph.limbs == 2 else "weighted"
        price = {} if graph.limbs == 2 else {"regrasp_price": 0.2}
        plan = planner.plan(start.stance, goal, cost, **price).unwrap()
        for here, points in sampled(graph, plan, 12):
            found += ruler.measured(here, grasps_of(graph, points), 2.0 * CLEARANCE)
    assert min(found)[0] >= CLEARANCE - 1e-9
    # They come so close that the clearance is decisive.
    ids = {box.id for box in jem.boxes}
    if robot != "two iiwa":
        assert min(gap for gap, _, other in found if other in ids) < 1.5 * CLEARANCE
    if robot == "mlivr3":
        between = [gap for gap, a, b in found if {a[:4], b[:4]} == {"limb"} and a[:5] != b[:5]]
        assert min(between) < 2.0 * CLEARANCE


def test_free_stances_keep_the_clearance(checked_graph, jem):
    """All shapes that are compared keep the clearance on random branches of the branch sets."""
    graph, rng, ruler = checked_graph, np.random.default_rng(3), Ruler(ROBOT, jem.boxes)
    found = []
    for s in rng.choice(len(graph), 500, replace=False):
        here, _ = configuration(graph, s, rng)
        found += ruler.measured(here, grasps_of(graph, enumerate(graph.points[s])), 0.05)
    assert CLEARANCE - 1e-9 <= min(found)[0] < 1.1 * CLEARANCE
