"""What a plan tells is what its stances and steps say."""

import math
import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mlivr_gym.errors import PlanError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.planners import Planner


@pytest.fixture(scope="module")
def plan(graph):
    return Planner(graph).plan(("D1a:4", "D1b:4"), (6.0, 0.0, 0.42), "base").unwrap()


def test_plans_are_equal_if_their_data_are(plan):
    again = Plan.from_dict(plan.to_dict())
    assert again == plan == pickle.loads(pickle.dumps(plan))
    assert hash(again) == hash(plan)
    other = replace(plan, statistics=replace(plan.statistics, expanded=10**6))
    assert other != plan
    assert plan != "plan"


def test_a_configuration_is_that_of_a_stance_counted_from_either_end(plan):
    count = len(plan.stances)
    for k in range(count):
        for one, other in zip(plan.configuration(k), plan.configuration(k - count), strict=True):
            np.testing.assert_array_equal(one, other)
    for k in (count, -count - 1):
        with pytest.raises(PlanError, match=f"k is {k}; the plan has {count} stances"):
            plan.configuration(k)


def test_footholds_are_the_points_of_each_limb_without_repetition(plan):
    for limb, points in enumerate(plan.footholds):
        held = [stance[limb] for stance in plan.stances]
        changes = [held[0], *(b for a, b in pairwise(held) if a != b)]
        assert list(points) == changes
    assert sum(map(len, plan.footholds)) == len(plan.steps) + len(plan.footholds)


@pytest.mark.parametrize("cost", ["steps", "base", "weighted"])
def test_the_figures_of_a_plan_are_those_of_its_motion(checked_graph, cost):
    """By plain sums over its steps; the price of a regrasp is 0.3 m."""
    price = {"regrasp_price": 0.3} if cost == "weighted" else {}
    start, goal = ("D2a:4", "D1b:3"), (6.3, 0.5, 0.35)
    plan = Planner(checked_graph).plan(start, goal, cost, **price).unwrap()
    places, metres = plan.motion.base_positions.tolist(), 0.0
    for before, after in pairwise(places):
        metres += math.dist(before, after)
    assert plan.base_translation == pytest.approx(metres)
    costs = {"steps": len(plan.steps), "base": metres, "weighted": metres + 0.3 * len(plan.steps)}
    assert plan.query.cost_of(plan.motion.base_positions) == pytest.approx(costs[cost])
    assert plan.cost == pytest.approx(costs[cost])


def test_the_least_manipulabilities_of_a_plan_are_of_all_stances_and_limbs(walk):
    for k in range(len(walk.stances)):
        w_m, w_b = walk.motion.w_m + 1.0, walk.motion.w_b + 1.0
        w_m[k, k % 2], w_b[k] = 0.01, 0.002
        changed = replace(walk, motion=replace(walk.motion, w_m=w_m, w_b=w_b))
        assert (changed.w_m_min, changed.w_b_min) == (0.01, 0.002)
