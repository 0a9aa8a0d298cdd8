"""Graphs and plans among obstacles and occupied points, and with shapes given by the user."""

import json
from dataclasses import replace

import numpy as np
import pytest
from coal_ruler import Ruler, grasps_of, sampled

from mlivr_gym import Box, Capsule, Settings, robot_spec, stance_graph
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import SettingError, ShapeError, StanceError
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.transitions.state import State

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)


ROBOT = robot_spec("mlivr2")


def test_obstacles_take_away_and_give_back(checked_graph):
    graph, planner = checked_graph, Planner(checked_graph)
    free = planner.plan(START, GOAL, "steps").unwrap()
    before = graph.successors(graph.state(START))
    box = Box.between("crate", "obstacle", (3.4, -1.0, -1.0), (3.7, 1.0, 0.2))
    graph.add_obstacles([box])
    blocked = planner.plan(START, GOAL, "steps").unwrap()
    assert blocked.cost >= free.cost
    assert blocked.world.obstacles == (box,)
    for here, _ in sampled(graph, blocked, 10):
        assert not contacts(graph.robot, (box,), here, 0.02 - 1e-9)
    assert Plan.from_dict(
        json.loads(json.dumps(blocked.to_dict())), graph.grasp_map
    ).world.obstacles == (box,)
    graph.remove_obstacles(["crate"])
    after = graph.successors(graph.state(START))
    for ours, theirs in zip(before, after, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert planner.plan(START, GOAL, "steps").unwrap().stances == free.stances


def test_boxes_replace_others_in_one_change(checked_graph):
    """The stances left are those among the boxes that are there, each compared as if alone."""
    rng = np.random.default_rng(7)
    corners = rng.uniform((2.5, -0.9, -0.9), (5.5, 0.7, 0.7), (4, 3))
    boxes = [Box.between(f"box{k}", "obstacle", low, low + 0.2) for k, low in enumerate(corners)]
    alone = []
    for box in boxes:
        checked_graph.add_obstacles([box])
        alone.append(checked_graph.branch_sets.copy())
        checked_graph.remove_obstacles()
    checked_graph.add_obstacles(boxes[:2])
    version = checked_graph.version
    checked_graph.add_obstacles(boxes[2:], replaced=["box0"])
    assert checked_graph.version == version + 1
    assert checked_graph.obstacles == tuple(boxes[1:])
    np.testing.assert_array_equal(
        checked_graph.branch_sets, alone[1] & alone[2] & alone[3]
    )  # fmt: skip
    with pytest.raises(ShapeError, match="no obstacle 'box0'"):
        checked_graph.add_obstacles(boxes[:1], replaced=["box0"])
    moved = Box.between("box1", "obstacle", corners[0], corners[0] + 0.2)
    checked_graph.add_obstacles([moved], replaced=["box1"])
    np.testing.assert_array_equal(
        checked_graph.branch_sets, alone[0] & alone[2] & alone[3]
    )  # fmt: skip
    checked_graph.remove_obstacles()


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
def test_occupied_points_are_not_grasped(jem, checked_graph, robot):
    graph = checked_graph if robot == "mlivr2" else stance_graph(jem, robot)
    start, goal = sample_task(graph, np.random.default_rng(1), 0.2)
    cost = {"cost": "weighted", "regrasp_price": 0.2}
    plan = Planner(graph).plan(start.stance, goal, **cost).unwrap()
    held = set(plan.stances[0])
    taken = sorted({point for stance in plan.stances for point in stance} - held)[:2]
    graph.occupy(taken)
    result = Planner(graph).plan(start.stance, goal, **cost)
    assert not any(point in taken for stance in result.unwrap().stances for point in stance)
    graph.occupy([plan.stances[0][0]])
    assert Planner(graph).plan(plan.stances[0], goal).reason == "start infeasible"
    with pytest.raises(StanceError, match="occupied"):
        graph.state(plan.stances[0])
    graph.vacate()
    assert Planner(graph).plan(start.stance, goal, **cost).unwrap().stances == plan.stances


CLEARANCE = 0.02


def best_postures(graph, stances):
    """Return the configuration of each stance in its best posture, and its grasps."""
    for stance in stances:
        s = graph.find(stance)
        branch_sets = tuple(1 << int(branch) for branch in graph.branch[s])
        yield (
            graph.configuration(State(tuple(stance), branch_sets)),
            grasps_of(graph, enumerate(stance)),
        )


def test_a_shelf_and_a_mast_take_away_what_they_touch(ladder):
    """The shapes are a box of the map, and capsules across each forearm and on each mount.

    Stances that are removed touch something in their best posture; the others keep the clearance.
    """
    settings = Settings(limb_threshold=0.05)
    shelf = Box.between("shelf", "obstacle", (0.3, -0.5, 0.5), (0.6, 0.5, 0.55))
    mast = Capsule("forearm", (-0.2, -0.5, 0.007), (-0.2, 0.5, 0.007), 0.03)
    arm = Capsule("base", (0.0, 0.0, 0.05), (-0.6, 0.0, 0.05), 0.03)
    masted = replace(ROBOT, name="masted", capsules=(*ROBOT.mounted[0].capsules, mast, arm))
    free = stance_graph(ladder, settings=replace(settings, collisions=False))
    shelved = replace(ladder, boxes=(*ladder.boxes, shelf))
    for world, robot in ((shelved, ROBOT), (ladder, masted)):
        graph, ruler = stance_graph(world, robot, settings), Ruler(robot, world.boxes)
        gone = [row for row in free.points.tolist() if graph.find(row) < 0]
        assert len(gone) > 10
        assert len(graph) == len(free) - len(gone) > 100
        for here, grasps in best_postures(free, gone):
            assert contacts(robot, world.boxes, here, CLEARANCE, grasps)
        for here, grasps in best_postures(graph, graph.points.tolist()):
            near = ruler.measured(here, grasps, 2.0 * CLEARANCE)
            assert not near or near[0][0] >= CLEARANCE - 1e-9


def test_faulty_obstacles_are_named(checked_graph, graph):
    box = Box.between("crate", "obstacle", (0, 0, 0), (1, 1, 1))
    with pytest.raises(ShapeError, match="a box 'crate' already exists"):
        checked_graph.add_obstacles([box, box])
    with pytest.raises(ShapeError, match="no obstacle 'chair'"):
        checked_graph.remove_obstacles(["chair"])
    with pytest.raises(SettingError, match="collisions=True"):
        graph.add_obstacles([box])
