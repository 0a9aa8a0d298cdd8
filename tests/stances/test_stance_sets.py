"""Sets of points that limbs may hold at once, against all sets and all stances."""

from collections import OrderedDict
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from map_data import few_of_a_wall
from paper import NO_COLLISIONS

from mlivr_gym import stance_graph
from mlivr_gym.stances import stance_sets, table_files
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.stance_sets import StanceSets


@pytest.fixture(scope="module", params=[(3, 24), (4, 16)])
def graph(request):
    """A graph of three or four limbs on a few points of a wall."""
    limbs, count = request.param
    return stance_graph(few_of_a_wall(count), f"mlivr{limbs}", NO_COLLISIONS)


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A cache folder of its own, and nothing in memory."""
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(table_files, "_memory", OrderedDict())
    return tmp_path / "cache"


def test_sets_are_all_in_reach_in_order_with_what_is_a_move_away(graph, empty_cache):
    sets, limbs = StanceSets.of(graph), graph.limbs
    every = np.array(list(combinations(range(len(graph.grasp_map)), limbs)))
    able = [all(graph.compatible[a, b] for a, b in combinations(row, 2)) for row in every.tolist()]
    every = every[able]
    expected = every[graph.solver.in_reach(every)]
    np.testing.assert_array_equal(sets.points, expected)
    assert len(sets) == len(expected) > 10
    held = [set(row) for row in expected.tolist()]
    for a, b in combinations(range(0, len(sets), 3), 2):
        common = set(sets.support_sets[a].tolist()) & set(sets.support_sets[b].tolist())
        assert bool(common) == (len(held[a] & held[b]) == limbs - 1)
    assert sets.support_sets.max() + 1 == sets.support_set_count


def test_there_are_no_sets_of_two_or_five_limbs_or_of_too_many(graph, empty_cache, monkeypatch):
    for limbs in (2, 5):
        other = StanceGraph(graph.grasp_map, replace(graph.robot, limbs=limbs), NO_COLLISIONS)
        assert StanceSets.of(other) is None
    monkeypatch.setattr(stance_sets, "MOST_SETS", 10)
    assert StanceSets.of(graph) is None
    assert not list(empty_cache.glob("sets-*.npz"))
