"""Stances and plans reported as free of collisions touch nothing, as measured by Coal."""

import numpy as np
import pytest
from coal_ruler import Ruler, grasps_of, sampled
from wrist_arms import iiwa_from_file

from mlivr_gym import robot_spec, stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.planners import Planner
from mlivr_gym.transitions.state import State

CLEARANCE, ROBOT = 0.02, robot_spec("mlivr2")


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
        stance = tuple(graph.points[s].tolist())
        allowed = (
            [b for b in range(16) if branch_set >> b & 1]
            for branch_set in graph.branch_sets[s].tolist()
        )
        bits = tuple(1 << int(rng.choice(some)) for some in allowed)
        here = graph.configuration(State(stance, bits))
        found += ruler.measured(here, grasps_of(graph, enumerate(stance)), 0.05)
    assert CLEARANCE - 1e-9 <= min(found)[0] < 1.1 * CLEARANCE
