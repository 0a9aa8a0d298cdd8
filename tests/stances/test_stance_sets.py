"""Sets of points that limbs may hold at once, against all sets and all stances."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from map_data import few_of_a_wall
from paper import NO_COLLISIONS

from mlivr_gym import stance_graph
from mlivr_gym.stances import stance_sets
from mlivr_gym.stances.stance_graph import StanceGraph


@pytest.fixture(scope="module", params=[(3, 24), (4, 16)])
def graph(request):
    """A graph of three or four limbs on a few points of a wall."""
    limbs, count = request.param
    return stance_graph(few_of_a_wall(count), f"mlivr{limbs}", NO_COLLISIONS)


def test_sets_are_all_in_reach_in_order(graph):
    sets, limbs = stance_sets.stance_sets(graph), graph.limbs
    every = np.array(list(combinations(range(len(graph.grasp_map)), limbs)))
    able = [all(graph.compatible[a, b] for a, b in combinations(row, 2)) for row in every.tolist()]
    every = every[able]
    np.testing.assert_array_equal(sets, every[graph.solver.in_reach(every)])
    assert len(sets) > 10


def test_there_are_no_sets_of_two_or_five_limbs_or_of_too_many(graph, monkeypatch):
    for limbs in (2, 5):
        other = StanceGraph(graph.grasp_map, replace(graph.robot, limbs=limbs), NO_COLLISIONS)
        assert stance_sets.stance_sets(other) is None
    monkeypatch.setattr(stance_sets, "MOST_SETS", 10)
    assert stance_sets.stance_sets(graph) is None
