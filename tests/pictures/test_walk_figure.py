"""The picture of a walk among obstacles tells plans apart, and shows on which side a box is."""

from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym import Box
from mlivr_gym.pictures import walk_figure as module
from mlivr_gym.pictures.flat_views import FROM_ABOVE, FROM_THE_SIDE
from mlivr_gym.pictures.route import plan_base_path
from mlivr_gym.pictures.walk_figure import WalkedPath, WalkedPlan, is_in_front, least_distance
from mlivr_gym.planners import Planner

BOX = Box.between("cargo", "obstacle", (3.0, -0.2, -0.2), (3.4, 0.2, 0.2))


def line(y, z):
    return np.array([[1.0, y, z], [5.0, y, z]])


@pytest.mark.parametrize(
    ("y", "z", "apart"), [(0.0, 0.0, 0.0), (0.5, 0.0, 0.3), (0.0, -0.6, 0.4), (0.5, 0.6, 0.5)]
)
def test_the_distance_of_a_path_from_a_box(y, z, apart):
    assert least_distance(line(y, z), BOX) == pytest.approx(apart, abs=1e-9)


@pytest.mark.parametrize(
    ("y", "z", "above", "side"),
    [
        (0.0, -0.6, True, False),  # below the box: hidden from above, not crossing from the side
        (0.0, 0.6, False, False),
        (0.6, 0.0, False, True),  # behind it, seen from the forward wall
        (-0.6, 0.0, False, False),
    ],
)
def test_a_box_hides_what_runs_behind_it(y, z, above, side):
    assert is_in_front(BOX, line(y, z), FROM_ABOVE) == above
    assert is_in_front(BOX, line(y, z), FROM_THE_SIDE) == side


@pytest.fixture
def drawn(graph, monkeypatch, tmp_path):
    """Two plans, the first abandoned after a step."""
    planner, kept = Planner(graph), []
    first = planner.plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()
    second = planner.plan(first.stances[1], (6.3, 0.5, 0.35), "base").unwrap()
    walked_plans = [WalkedPlan(first, 1), WalkedPlan(second, len(second.steps))]
    monkeypatch.setattr(module, "save_figure", lambda figure, path: kept.append(figure))
    module.walk_figure(graph.grasp_map, walked_plans, tmp_path / "walk.png")
    return kept[0], walked_plans


def test_a_walk_is_what_was_walked(drawn):
    _, walked_plans = drawn
    walk = WalkedPath.of(walked_plans)
    first, second = (walked.plan.motion.base_positions for walked in walked_plans)
    np.testing.assert_allclose(walk.stances, np.vstack([first[:2], second[1:]]))
    np.testing.assert_allclose(walk.replans, first[1:2])
    np.testing.assert_allclose(walk.line[0], first[0])
    np.testing.assert_allclose(walk.line[-1], second[-1])
    np.testing.assert_allclose(walked_plans[0].abandoned_path[[0, -1]], first[[1, -1]])
    steps = np.linalg.norm(np.diff(walk.stances, axis=0), axis=1)
    assert walk.length == pytest.approx(steps.sum())


def test_what_was_walked_and_what_was_given_up_make_the_whole_way(drawn):
    """Sample by sample, also where steps go round an arc."""
    plan = drawn[1][0].plan
    steps = tuple(replace(step, path="arc") for step in plan.steps)
    plan = replace(plan, motion=replace(plan.motion, steps=steps))
    whole = plan_base_path(plan)
    assert len(plan.steps) > 1
    for taken in range(len(plan.steps) + 1):
        walked = WalkedPlan(plan, taken)
        np.testing.assert_allclose(
            np.vstack([walked.walked_path, walked.abandoned_path[1:]]), whole, atol=1e-12
        )
