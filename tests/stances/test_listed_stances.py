"""The stances of a robot without a table are computed once, and read from the cache folder."""

import numpy as np
import pytest
from numba import typeof

from mlivr_gym import stance_graph
from mlivr_gym.postures.postures import FIELDS
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.stances import build, parts, table_files
from mlivr_gym.world.boxes import Box


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A cache folder without tables."""
    for module in (parts, table_files):
        monkeypatch.setattr(module, "cache_folder", lambda: tmp_path)
    return tmp_path


@pytest.fixture
def solved(monkeypatch, empty_cache):
    """The numbers of stances that were computed, in a cache folder that is empty at first."""
    counted, solve = [], PostureSolver.solve

    def counting(self, stances, **options):
        counted.append(len(stances))
        return solve(self, stances, **options)

    monkeypatch.setattr(PostureSolver, "solve", counting)
    return counted


def same(first, second):
    assert np.array_equal(first.points, second.points)
    assert first.listed.counts == second.listed.counts
    for name in FIELDS:
        one, other = (getattr(graph.listed.postures, name) for graph in (first, second))
        assert typeof(one) == typeof(other)  # so that the same machine code serves both
        assert np.array_equal(one, other), name
    assert typeof(first.table) == typeof(second.table)


def test_a_second_graph_reads_what_the_first_one_computed(solved):
    first = stance_graph(robot="mlivr2-ur3e")
    assert solved == [len(first.pairs)]
    second = stance_graph(robot="mlivr2-ur3e")
    assert len(solved) == 1
    same(first, second)
    points = tuple(first.points[100])
    steps, expected = (graph.successors(graph.state(points)) for graph in (second, first))
    assert steps
    for field in ("limb", "point", "base_position", "branch_sets"):
        assert np.array_equal(getattr(steps, field), getattr(expected, field))
    second.add_obstacles([Box.between("bag", "obstacle", (3.0, -0.3, -0.3), (3.4, 0.3, 0.3))])
    same(first, stance_graph(robot="mlivr2-ur3e"))


def test_small_maps_leave_no_files(empty_cache, small_map):
    stance_graph(small_map)
    assert len(stance_graph(small_map).pairs) < build.LEAST_STORED
    assert not list(empty_cache.glob("parts-*"))
