"""What a plan tells is what its stances and steps say."""

from itertools import pairwise

import numpy as np
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


def test_sums_and_least_values_are_those_of_its_parts(plan):
    positions = plan.motion.base_positions
    moved = sum(np.linalg.norm(b - a) for a, b in pairwise(positions))
    assert plan.base_translation == pytest.approx(moved, abs=1e-12)
    assert plan.cost == pytest.approx(moved, abs=1e-9)
    assert plan.w_m_min == min(value for row in plan.motion.w_m for value in row)
    assert plan.actions == tuple((step.limb, step.to_point) for step in plan.steps)
