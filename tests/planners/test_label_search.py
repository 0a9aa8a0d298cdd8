"""Walks over a roadmap against shortest paths of another library."""

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlivr_gym.planners import label_search
from mlivr_gym.planners.label_search import Origins, Roads, cheapest_walk

STANCES, LIMBS, BITS = 9, 3, 3


def random_roads(rng, pairs):
    """Roads between random stances with random masks, and the cost of each."""
    rows = []
    released = rng.integers(0, 1 << BITS, (STANCES, LIMBS))
    for _ in range(pairs):
        a, b = rng.choice(STANCES, 2, replace=False)
        limb, cost = int(rng.integers(LIMBS)), float(rng.choice([0.5, 1.0, 2.0, np.inf]))
        kept, turn = rng.integers(1, 1 << BITS, LIMBS), int(rng.integers(LIMBS))
        after = (limb - turn) % LIMBS
        for s, t, i, j, masks in (
            (a, b, limb, after, kept),
            (b, a, after, limb, np.roll(kept, -turn)),
        ):
            there = masks.copy()
            there[i] = released[t, j]
            rows.append((s, t, i, cost, there, (i - j) % LIMBS))
    rows.sort(key=lambda row: row[0])
    source = np.array([row[0] for row in rows])
    roads = Roads(
        np.searchsorted(source, np.arange(STANCES + 1)).astype(np.int32),
        np.array([row[1] for row in rows], dtype=np.int32),
        np.array([row[2] for row in rows], dtype=np.uint8),
        np.array([row[5] for row in rows], dtype=np.uint8),
        np.array([row[4] for row in rows], dtype=np.uint16),
        released.astype(np.uint16),
    )
    return roads, np.array([row[3] for row in rows]), source


def every_state(roads, cost, source, start, masks):
    """All stances with all masks that can be come to, in the words of the rule."""
    states, waiting = nx.DiGraph(), [(start, masks)]
    states.add_node(waiting[0])
    while waiting:
        here = waiting.pop()
        for e in np.flatnonzero((source == here[0]) & np.isfinite(cost)):
            limb = int(roads.limb[e])
            if not here[1][limb] & roads.released[here[0], limb]:
                continue
            after = tuple(
                int(roads.kept[e, i]) & (here[1][i] if i != limb else -1) for i in range(LIMBS)
            )
            if 0 in after:
                continue
            turn = int(roads.turn[e])
            there = int(roads.other[e]), after[turn:] + after[:turn]
            if there not in states:
                waiting.append(there)
            old = states.get_edge_data(here, there, {"cost": np.inf})["cost"]
            states.add_edge(here, there, cost=min(old, float(cost[e])))
    return states


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32), pairs=st.integers(4, 30))
def test_walks_are_the_cheapest_by_another_library(seed, pairs):
    rng = np.random.default_rng(seed)
    roads, cost, source = random_roads(rng, pairs)
    goal, start = (int(s) for s in rng.choice(STANCES, 2, replace=False))
    masks = tuple(int(m) for m in rng.integers(1, 1 << BITS, LIMBS))
    plain = nx.DiGraph()
    plain.add_nodes_from(range(STANCES))
    for s, t, c in zip(source.tolist(), roads.other.tolist(), cost.tolist(), strict=True):
        plain.add_edge(t, s, cost=min(c, plain.get_edge_data(t, s, {"cost": np.inf})["cost"]))
    away = nx.single_source_dijkstra_path_length(plain, goal, weight="cost")
    h = np.array([away.get(s, np.inf) for s in range(STANCES)])
    walk = cheapest_walk(
        roads, cost, h, Origins(np.array([start]), np.array([masks]), np.array([0.25])), (1.0,)
    )
    states = every_state(roads, cost, source, start, masks)
    lengths = nx.single_source_dijkstra_path_length(states, (start, masks), weight="cost")
    best = min((c for (s, _), c in lengths.items() if s == goal), default=None)
    if walk is None:
        assert best is None
        return
    assert sum(cost[walk.steps]) == pytest.approx(best)
    assert (walk.stances[0], walk.stances[-1], walk.origin) == (start, goal, 0)
    at = (start, masks)
    for step, stance, after in zip(walk.steps, walk.stances[1:], walk.masks[1:], strict=True):
        there = (stance, tuple(after.tolist()))
        assert states.has_edge(at, there)
        assert source[step] == at[0]
        at = there


def test_too_many_labels_are_no_walk(monkeypatch):
    monkeypatch.setattr(label_search, "ROOM", 0)
    rng = np.random.default_rng(0)
    roads, cost, _ = random_roads(rng, 30)
    origins = Origins(np.array([0]), np.full((1, LIMBS), 7), np.zeros(1))
    assert cheapest_walk(roads, cost, np.ones(STANCES), origins, (1.0, 2.0)) is None


def test_where_labels_run_out_of_room_the_next_factor_is_taken(monkeypatch):
    """With just too little room for the cheapest walk another is found, within its factor."""
    rng, found = np.random.default_rng(3), 0
    while found < 5:
        roads, cost, source = random_roads(rng, 30)
        plain = nx.DiGraph()
        for s, t, c in zip(source.tolist(), roads.other.tolist(), cost.tolist(), strict=True):
            plain.add_edge(t, s, cost=min(c, plain.get_edge_data(t, s, {"cost": np.inf})["cost"]))
        away = nx.single_source_dijkstra_path_length(plain, 0, weight="cost")
        h = np.array([away.get(s, np.inf) for s in range(STANCES)])
        origins = Origins(np.array([1]), np.full((1, LIMBS), 7), np.zeros(1))
        best = cheapest_walk(roads, cost, h, origins, (1.0,))
        rooms = []
        for room in range(400):
            monkeypatch.setattr(label_search, "ROOM", room)
            if cheapest_walk(roads, cost, h, origins, (1.0,)) is not None:
                break
            walk = cheapest_walk(roads, cost, h, origins, (1.0, 1.5, 4.0))
            if walk is not None:
                assert sum(cost[walk.steps]) <= 4.0 * sum(cost[best.steps]) + 1e-9
                rooms.append(room)
        monkeypatch.undo()
        found += bool(rooms)
