"""Fewest steps whose checks were made on demand, against graphs all of whose steps were checked."""

import numpy as np
import pytest

from mlivr_gym import Box, stance_graph
from mlivr_gym.planners import Planner, searches
from mlivr_gym.planners.level_search import LevelSearch
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.table_build import fill_rows
from mlivr_gym.transitions.state import State

BOX = Box.between("crate", "obstacle", (1.5, -0.2, -0.6), (1.9, 0.2, 0.1))


@pytest.fixture(scope="module")
def tracks(jem):
    keep = [point.split(":")[0] in ("D1a", "D2a", "F1b", "F2b", "A1a", "A2b") for point in jem.ids]
    return jem.subset(np.array(keep), "six tracks")


@pytest.fixture
def lazy(tracks):
    """A graph of which nothing is known."""
    return stance_graph(tracks)


@pytest.fixture(scope="module")
def full(tracks):
    """A graph of which every step was checked."""
    graph = stance_graph(tracks)
    fill_rows(graph)
    return graph


def test_among_obstacles_it_follows_on_a_search_that_is_cut_short(tracks, full, monkeypatch):
    """All steps but those close to a crate are known; each limb is on one branch at the start."""
    found, rng, graph = [], np.random.default_rng(2), full
    without = graph.steps.edges.copy()
    graph.add_obstacles([BOX])
    graph.node_postures(np.arange(len(graph)))
    is_held = np.flatnonzero(graph.steps.branch_sets.all(axis=1))
    monkeypatch.setattr(LevelSearch, "tree", lambda _: found.append(1) or np.zeros((0, 2, 3)))
    for _ in range(12):
        start = graph.state(graph.points[rng.choice(is_held)].tolist())
        one = (rng.choice([1 << b for b in range(16) if s >> b & 1]) for s in start.branch_sets)
        start = State(start.stance, tuple(map(int, one)))
        goal = np.clip(graph.base_position[rng.integers(len(graph))], *tracks.cabin)
        results = []
        for few in (1, 10**9):
            monkeypatch.setattr(searches, "FEW_EXPANSIONS", few)
            result = Planner(graph).plan(start, goal, "steps", goal_tolerance=0.05)
            plan = result.plan
            results.append((result.reason, plan and (plan.cost, plan.statistics.bound)))
        assert results[0] == results[1], (start, goal)
    edges = graph.steps.edges
    graph.remove_obstacles()
    assert 3 < len(found) <= 12
    assert edges["known"][(without["known"] == 1) & (without["kept"] == 0)].all()
    assert not (edges["kept"] & ~without["kept"]).any()


def test_a_start_pose_counts_as_a_step(lazy, full):
    """From a base pose that the start stance does not have."""
    s = 7
    position = full.base_position[s] + [0.004, 0.003, 0.0]
    pose = (*position, *full.configuration(full.state(full.points[s].tolist()))[1])
    start, goal = full.ids(full.points[s].tolist()), full.base_position[100]
    found, truth = (
        Planner(graph).plan(start, goal, "steps", start_pose=pose, goal_tolerance=0.05)
        for graph in (lazy, full)
    )
    assert found.unwrap().cost == truth.unwrap().cost >= 1
    assert found.plan.stances[0] == truth.plan.stances[0]


def test_limits_of_expansions_and_time_end_it(lazy):
    start, goal = lazy.ids(lazy.points[3].tolist()), lazy.base_position[100]
    for limits in ({"limit": 1}, {"time_limit": 0.0}):
        found = Planner(lazy).plan(start, goal, "steps", goal_tolerance=0.05, **limits)
        assert found.reason == "limit reached"
    assert Planner(lazy).plan(start, goal, "steps", goal_tolerance=0.05)


@pytest.mark.parametrize("blocked", [False, True])
def test_steps_are_those_over_all_steps_and_few_are_checked(tracks, lazy, full, blocked):
    if blocked:
        full = stance_graph(tracks)
        for graph in (lazy, full):
            graph.add_obstacles([BOX])
            graph.occupy([tracks.ids[4], tracks.ids[20]])
        fill_rows(full)
    assert full.is_complete
    assert not lazy.is_complete
    rng, lengths, checked = np.random.default_rng(1), [], []
    for _ in range(25):
        start = random_state(full, rng)
        if start.pose is None and rng.integers(2):  # a limb that held keeps some branches only
            left = full.successors(start)
            start = left.after(start, int(rng.integers(len(left.limb))))
        goal = np.clip(full.base_position[rng.integers(len(full))], *tracks.cabin)
        before = int(lazy.steps.edges["known"].sum())
        found, truth = (
            Planner(graph).plan(start, goal, "steps", goal_tolerance=0.05) for graph in (lazy, full)
        )
        assert bool(found) == bool(truth), (start, goal)
        assert found.reason == truth.reason
        checked.append(int(lazy.steps.edges["known"].sum()) - before)
        if found:
            lengths.append(len(found.plan.steps))
            assert found.plan.cost == truth.plan.cost
            assert found.plan.statistics.bound == 1.0
    assert max(lengths) > 3
    assert sum(checked) < 0.5 * full.steps.edges["known"].sum()
