"""What a plan tells is what its stances and steps say."""

from itertools import pairwise

import pytest

from mlivr_gym.planners import Planner


@pytest.fixture(scope="module")
def plan(graph):
    return Planner(graph).plan(("D1a:4", "D1b:4"), (6.0, 0.0, 0.42), "base").unwrap()


def test_footholds_are_the_points_of_each_limb_without_repetition(plan):
    for limb, points in enumerate(plan.footholds):
        held = [stance[limb] for stance in plan.stances]
        changes = [held[0], *(b for a, b in pairwise(held) if a != b)]
        assert list(points) == changes
    assert sum(map(len, plan.footholds)) == len(plan.steps) + len(plan.footholds)
