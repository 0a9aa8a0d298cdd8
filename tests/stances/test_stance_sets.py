"""Sets of points that limbs may hold at once, against all sets and all stances."""

from collections import OrderedDict
from dataclasses import replace
from itertools import combinations
from zipfile import ZIP_STORED

import numpy as np
import pytest
from map_data import few_of_a_wall
from paper import NO_COLLISIONS

from mlivr_gym import stance_graph
from mlivr_gym.stances import stance_sets, table_files
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.stance_sets import SET_TABLES, StanceSets, count_sets, sets_from


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


def test_sets_of_stances_are_found_in_any_order(graph):
    sets, rng = StanceSets.of(graph), np.random.default_rng(0)
    rows = rng.integers(0, len(sets), 50)
    stances = rng.permuted(sets.points[rows].astype(np.int64), axis=1)
    np.testing.assert_array_equal(sets.find(stances), rows)
    none = np.array([[0, 0, 0, 0][: graph.limbs]])
    assert sets.find(none).tolist() == [-1]
    nothing = StanceSets(sets.points[:0], sets.support_sets[:0], 0)
    assert nothing.find(stances[:2]).tolist() == [-1, -1]


def test_sets_are_kept_and_what_is_no_file_of_them_is_passed_over(graph, empty_cache, caplog):
    told = []
    first = StanceSets.of(graph, told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    (file,) = empty_cache.glob("sets-*.npz")
    again = told.copy()
    table_files._memory.clear()
    read = StanceSets.of(graph, told.append, build=False)
    assert told == again
    np.testing.assert_array_equal(read.points, first.points)
    np.testing.assert_array_equal(read.support_sets, first.support_sets)
    for content in (b"nothing", file.read_bytes()[:200]):
        table_files._memory.clear()
        file.write_bytes(content)
        assert StanceSets.of(graph, build=False) is None
        assert "is damaged, or not of format" in caplog.text
        np.testing.assert_array_equal(StanceSets.of(graph).points, first.points)
    table_files._memory.clear()
    arrays = dict(SET_TABLES.arrays(graph, file))
    for wrong in (
        {"points": first.points + np.uint16(len(graph.grasp_map))},
        {"supports": first.support_sets + np.int32(1)},
        {"support_count": np.array(1)},
    ):
        file.write_bytes(SET_TABLES.pack(graph, arrays | wrong, ZIP_STORED))
        assert StanceSets.of(graph, build=False) is None
        table_files._memory.clear()


def test_there_are_no_sets_of_two_or_five_limbs_or_of_too_many(graph, empty_cache, monkeypatch):
    for limbs in (2, 5):
        other = StanceGraph(graph.grasp_map, replace(graph.robot, limbs=limbs), NO_COLLISIONS)
        assert StanceSets.of(other) is None
    monkeypatch.setattr(stance_sets, "MOST_SETS", 10)
    assert StanceSets.of(graph) is None
    assert not list(empty_cache.glob("sets-*.npz"))


def test_counts_and_lists_of_sets_are_those_of_all_combinations():
    """Of random pairs that may be held together."""
    rng = np.random.default_rng(0)
    for limbs in (3, 4):
        together = rng.random((12, 12)) < 0.7
        together = np.triu(together, 1) | np.triu(together, 1).T
        expected = [
            row
            for row in combinations(range(12), limbs)
            if all(together[a, b] for a, b in combinations(row, 2))
        ]
        counts = np.zeros(12, dtype=np.int64)
        assert count_sets(together, limbs, len(expected), counts)
        assert counts.tolist() == np.bincount([row[0] for row in expected], minlength=12).tolist()
        assert not count_sets(together, limbs, len(expected) - 1, np.zeros(12, dtype=np.int64))
        for first in range(12):
            out = np.empty((counts[first], limbs), dtype=np.int64)
            sets_from(together, first, out)
            assert list(map(tuple, out.tolist())) == [row for row in expected if row[0] == first]
