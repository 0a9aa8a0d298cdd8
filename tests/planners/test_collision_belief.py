"""The belief where obstacles block the robot, and a search that avoids such places."""

import numpy as np
import pytest

from mlivr_gym.planners.collision_belief import (
    CELL_EDGE,
    PRIOR_CHECKS,
    CollisionBelief,
    FailureWeight,
    cells_of,
)


def test_costs_are_the_logarithm_of_the_share_of_checks_that_succeed():
    rng = np.random.default_rng(0)
    positions = rng.uniform(-1.0, 1.0, (200, 3))
    belief = CollisionBelief(cells_of(positions))
    nodes, failures = rng.integers(0, 200, 80), rng.random(80)
    belief.record(nodes[:30], failures[:30])
    belief.record(nodes[30:], failures[30:])
    costs = belief.costs()[belief.cells]
    places = [tuple(np.floor(position / CELL_EDGE)) for position in positions]
    for node, place in enumerate(places):
        here = [f for n, f in zip(nodes.tolist(), failures, strict=True) if places[n] == place]
        share = 1.0 - sum(here) / (len(here) + PRIOR_CHECKS)
        assert np.exp(-costs[node]) == pytest.approx(share)


def test_positions_share_a_cell_if_they_lie_in_the_same_cube():
    positions = np.random.default_rng(1).uniform(-0.3, 0.3, (300, 3))
    cells = cells_of(positions)
    cubes = np.unique(np.floor(positions / CELL_EDGE), axis=0, return_inverse=True)[1].ravel()
    assert (
        len(np.unique(cells)) == len(np.unique(cubes)) == len(set(zip(cells, cubes, strict=True)))
    )


def test_the_weight_falls_only_when_searches_grow():
    weight = FailureWeight()
    before = weight.value
    for expanded in (900, 500, 6_999):
        weight.update(expanded)
        assert weight.value == before
    weight.update(7_001)
    assert weight.value == before / 2
