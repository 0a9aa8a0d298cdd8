"""The closed loop arrives among things that its map lacks, or stops where it is."""

import numpy as np
import pytest

from mlivr_gym import Box, MlivrError, stance_graph
from mlivr_gym.closed_loop.depth_camera import DepthCamera
from mlivr_gym.closed_loop.walk import ARRIVED, FAILED, STOPPED, TRIES, walk
from mlivr_gym.planners import Planner

START, GOAL = ("D2a:4", "D2b:4"), (4.2, 0.0, 0.42)
BAG = Box.between("bag", "obstacle", (3.5, -0.35, -0.9), (3.8, 0.35, 0.0))


@pytest.fixture(scope="module")
def graph(jem):
    return stance_graph(jem)


@pytest.fixture(scope="module")
def plan(graph):
    return Planner(graph).plan(START, GOAL, "steps").unwrap()


def kinds(walked):
    return [event.kind for event in walked.events]


def test_without_surprises_it_takes_the_steps_of_the_plan(graph, plan):
    walked = walk(graph, START, GOAL, camera=DepthCamera())
    assert walked.outcome == ARRIVED
    assert walked.steps == len(plan.steps)
    assert not walked.sensed
    assert not walked.refused
    assert walked.plans == [(walked.plans[0][0], len(plan.steps))]  # it never changes its mind
    assert 0.0 < walked.peak_force < 100.0


def test_a_refused_point_is_tried_again_then_avoided(graph, plan):
    limb, point = plan.actions[0]
    walked = walk(graph, START, GOAL, refusing=[point])
    assert walked.outcome == ARRIVED
    assert walked.refused == (point,)
    refused = [event.values for event in walked.events if event.kind == "refused"]
    assert [value["point"] for value in refused] == [point] * TRIES
    assert refused[0] == {"limb": limb, "point": point, "failure": "refused grasp"}
    assert all(point != event.values["point"] for event in walked.events if event.kind == "step")
    assert graph.occupied == frozenset()  # the graph is as it was
    assert graph.obstacles == ()


def test_it_sees_what_is_in_its_way_and_goes_round(graph):
    blind = walk(graph, START, GOAL, unknown=[BAG])
    assert blind.outcome == FAILED
    assert "bag" in blind.reason
    seeing = walk(graph, START, GOAL, unknown=[BAG], camera=DepthCamera())
    assert seeing.outcome == ARRIVED
    assert seeing.sensed
    assert graph.obstacles == ()
    again = walk(graph, START, GOAL, unknown=[BAG], camera=DepthCamera())
    assert kinds(again) == kinds(seeing)  # the same seed, the same walk
    assert again.duration == seeing.duration
    assert again.sensed == seeing.sensed


def test_it_stops_where_no_way_is_left(graph, plan):
    points = {point for stance in plan.stances for point in stance} - set(START)
    graph.occupy([point for point in graph.grasp_map.ids if point not in {*points, *START}])
    walked = walk(graph, START, GOAL, refusing=sorted(points))
    graph.vacate()
    assert walked.outcome == STOPPED
    assert walked.reason
    assert walked.refused  # it tried what the plan offers
    assert walked.steps == 0
    assert kinds(walked)[-1] == "end"


def test_it_stops_after_the_steps_that_it_may_take(graph, plan):
    walked = walk(graph, START, GOAL, max_steps=1)
    assert (walked.outcome, walked.steps) == (STOPPED, 1)
    walked = walk(graph, START, GOAL, max_steps=len(plan.steps))
    assert (walked.outcome, walked.steps) == (ARRIVED, len(plan.steps))


def test_a_goal_that_is_reached_needs_no_step(graph):
    here = graph.posture_of(graph.state(START)).base_position[0]
    walked = walk(graph, START, here.tolist())
    assert (walked.outcome, walked.steps) == (ARRIVED, 0)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"refusing": ["X9:1"]}, "X9:1"),
        ({"refusing": [START[0]]}, "holds at the start"),
        ({"unknown": ["box"]}, "unknown"),
        ({"camera": "wide"}, "camera"),
        ({"cost": "time"}, "time"),
        ({"max_steps": 0}, "max_steps"),
        ({"goal": (np.nan, 0.0, 0.0)}, "goal"),
        ({"seed": -1}, "seed"),
    ],
)
def test_wrong_arguments_are_named(graph, given, named):
    task = {"start": START, "goal": GOAL} | given
    with pytest.raises(MlivrError, match=named):
        walk(graph, **task)


def test_a_box_that_touches_the_robot_at_the_start_is_named(graph):
    with pytest.raises(MlivrError, match=r"here.* touch at the start"):
        walk(graph, START, GOAL, unknown=[Box.between("here", "obstacle", (2, 0, -0.6), (3, 1, 0))])


def test_unknown_boxes_need_names_of_their_own(graph):
    with pytest.raises(MlivrError, match="bag"):
        walk(graph, START, GOAL, unknown=[BAG, BAG])
