"""What a plan tells is what its stances and steps say, and a faulty file is refused by name."""

import json
import math
import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from plans import altered

from mlivr_gym.errors import PlanError
from mlivr_gym.planners import Plan, Planner


@pytest.fixture(scope="module")
def data(walk):
    """A plan of several steps, as plain data."""
    return json.loads(json.dumps(walk.to_dict()))


FAULTS = [
    (("branches", 1, 0), 1_000_000, r"^motion\.branches\[1\]\[0\] is 1000000; .* from 0 to 7"),
    (("branches", 1), [1], "branches"),
    (("steps", 0, "limb"), 2, r"steps\[0\].limb is 2; .* from 0 to 1"),
    (("steps", 0, "limb"), 1, "does not lead from"),
    (("steps", 0, "knots", 1, 1, 3), 1e300, r"knots\[1\]\[1\]\[3\] is 1e.300; .* -100 to 100"),
    (("steps", 0, "rests", 0), 1, r"steps\[0\]\.rests must rise from 0 to \d+, the number"),
    (("base_quaternions", 0), [0, 0, 0, 0], r"base_quaternions\[0\] has length 0; it must be 1"),
    (("stances", 0), ["D2a:4"], r"stances\[0\] has 1 entries; it must have 2"),
]


@pytest.mark.parametrize(("path", "value", "words"), FAULTS)
def test_a_faulty_plan_is_refused_by_name(jem, data, path, value, words):
    with pytest.raises(PlanError, match=words):
        Plan.from_dict(altered(data, ("motion", *path), value), jem)


def test_a_point_that_the_map_lacks_is_named_though_the_fingerprint_fits(jem, data):
    """The first stance and all that goes with it name another point."""
    limb = data["motion"]["steps"][0]["limb"]
    other = altered(data, ("motion", "stances", 0, limb), "Q:1")
    del other["checksum"]
    other["motion"]["steps"][0]["from_point"] = "Q:1"
    assert Plan.from_dict(other).stances[0][limb] == "Q:1"
    for faulty in (other, altered(data, ("world", "occupied"), ["Q:1"])):
        with pytest.raises(PlanError, match="unknown graspable point 'Q:1'"):
            Plan.from_dict(faulty, jem)


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
