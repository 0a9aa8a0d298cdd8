"""Sets of points that limbs may hold at once, and where the positions of points lie."""

import itertools
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from map_data import few_of_a_wall
from paper import NO_COLLISIONS

from mlivr_gym import stance_graph
from mlivr_gym.stances import stance_sets
from mlivr_gym.stances.obstacles import CELL_EDGE, PositionCells, mark_close_cells
from mlivr_gym.stances.point_pairs import pairs_within
from mlivr_gym.stances.random_states import order_around_body
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


@pytest.mark.parametrize("span", [0.05, 0.4, 1.6, 12.0])
def test_pairs_are_those_of_a_plain_comparison(jem, span):
    here = jem.positions
    near = {
        (a, b)
        for a, b in itertools.combinations(range(len(jem)), 2)
        if np.sqrt(((here[a] - here[b]) ** 2).sum()) <= span + 1e-9
    }
    found = pairs_within(jem, span)
    assert found.dtype == np.int64
    assert {tuple(sorted(pair)) for pair in found.tolist()} == near
    assert len(found) == len(near)


def test_three_points_are_in_order_as_they_are(jem):
    """Every order of three is one of the three turns, in one of the two senses."""
    rows = np.random.default_rng(0).permuted(np.tile(np.arange(len(jem)), (200, 1)), axis=1)[:, :3]
    np.testing.assert_array_equal(order_around_body(jem, rows), rows)


@pytest.mark.parametrize("limbs", [4, 5, 6, 8])
def test_points_run_round_their_centroid(jem, limbs):
    deck, rng = np.flatnonzero(np.array(jem.faces) == "deck"), np.random.default_rng(limbs)
    rows = np.array([rng.choice(deck, limbs, replace=False) for _ in range(200)])
    found = order_around_body(jem, rows)
    np.testing.assert_array_equal(found[:, 0], rows[:, 0])
    np.testing.assert_array_equal(np.sort(found), np.sort(rows))
    senses = set()
    for row, drawn in zip(found, rows, strict=True):
        x, y, _ = (jem.positions[row] - jem.positions[row].mean(axis=0)).T
        # Once round: every turn in one sense, and together less than a whole one.
        turns = np.cumsum([(b - a) % (2 * np.pi) for a, b in pairwise(np.arctan2(y, x))])
        sense = turns[-1] < 2 * np.pi
        if not sense:
            turns = np.cumsum([(a - b) % (2 * np.pi) for a, b in pairwise(np.arctan2(y, x))])
        assert turns[-1] < 2 * np.pi + 1e-9
        senses.add(bool(sense))
        order = row.tolist()
        assert order.index(drawn[1]) < order.index(drawn[2])
    assert senses == {True, False}


@pytest.mark.parametrize("count", [0, 1, 500])
def test_each_position_lies_in_its_cell_and_each_cell_has_positions(count):
    rng = np.random.default_rng(count)
    positions = rng.uniform(-0.4, 0.3, (count, 3))
    cells = PositionCells.of(positions)
    place = np.floor(positions / CELL_EDGE)
    expected, cell = np.unique(place, axis=0, return_inverse=True)
    np.testing.assert_allclose(cells.low, CELL_EDGE * expected, atol=1e-12)
    np.testing.assert_array_equal(cells.cell, cell.reshape(-1))


def test_cells_are_close_to_a_box_that_one_of_their_positions_may_reach():
    rng = np.random.default_rng(2)
    low = CELL_EDGE * rng.integers(-20, 20, (400, 3))
    corners = np.sort(rng.uniform(-2.0, 2.0, (6, 2, 3)), axis=1)
    close, least = np.zeros(len(low), dtype=np.bool_), np.full(len(low), np.inf)
    mark_close_cells(low, corners, 0.5, close)
    for first, last in corners:
        # The position of a cell that is closest to a box, and that of the box closest to it.
        position = np.clip(np.clip(low, first, last), low, low + CELL_EDGE)
        apart = np.linalg.norm(position - np.clip(position, first, last), axis=1)
        least = np.minimum(least, apart)
    assert 50 < close.sum() < 350
    np.testing.assert_array_equal(close, least <= 0.5)
