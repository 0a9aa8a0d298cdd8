"""What a plan tells is what its stances and steps say."""

import pickle
from dataclasses import replace
from itertools import pairwise

import pytest

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


def test_footholds_are_the_points_of_each_limb_without_repetition(plan):
    for limb, points in enumerate(plan.footholds):
        held = [stance[limb] for stance in plan.stances]
        changes = [held[0], *(b for a, b in pairwise(held) if a != b)]
        assert list(points) == changes
    assert sum(map(len, plan.footholds)) == len(plan.steps) + len(plan.footholds)
