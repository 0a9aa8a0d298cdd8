"""Which stances serve, against shortest paths of another library."""

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlivr_gym.planners import roadmap_use
from mlivr_gym.planners.roadmap_use import AROUND, LEAST, most_used, use_of


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32), joined=st.integers(5, 40))
def test_stances_serve_for_the_walks_that_pass_through_them(seed, joined):
    """By base translation, where no two walks are of one length."""
    rng, count = np.random.default_rng(seed), 16
    base = rng.uniform(0.0, 0.5, (count, 3))
    plain = nx.gnm_random_graph(count, joined, seed=int(rng.integers(2**32)))
    for a, b in plain.edges:
        plain[a][b]["length"] = np.linalg.norm(base[a] - base[b]) + LEAST
    pairs = np.array(plain.edges)
    draws, expected = np.random.default_rng(0), np.zeros(count)
    for _ in range(roadmap_use.TREES):
        goal = base[draws.integers(count)]
        goals = set(np.flatnonzero(np.linalg.norm(base - goal, axis=1) <= AROUND).tolist())
        walks = nx.multi_source_dijkstra_path(plain, goals, weight="length")
        behind = np.zeros(count)
        for walk in walks.values():
            behind[walk[:-1]] += 1.0
        expected += np.sqrt(behind)
    told = []
    np.testing.assert_allclose(use_of(pairs, base, "base", told.append), expected)
    assert told[-1] == 1.0


def test_by_steps_the_middle_of_a_star_serves_most():
    """Its ends are far apart but all one step from it."""
    base = np.vstack([np.zeros(3), 5.0 * np.eye(3), -5.0 * np.eye(3)])
    use = use_of(np.array([(0, k) for k in range(1, 7)]), base, "steps")
    assert use.argmax() == 0
    assert use[1:].max() < 0.7 * use[0]
    np.testing.assert_array_equal(most_used(use, 1), use == use[0])


@pytest.mark.parametrize(
    ("most", "kept"), [(0, []), (2, [1, 3]), (3, [0, 1, 3]), (9, [0, 1, 2, 3])]
)
def test_the_first_of_those_that_serve_as_much_are_taken(most, kept):
    chosen = most_used(np.array([1.0, 2.0, 1.0, 3.0]), most)
    assert np.flatnonzero(chosen).tolist() == kept
