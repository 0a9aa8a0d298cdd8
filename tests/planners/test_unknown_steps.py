"""Plans over steps that are checked on demand, against graphs all of whose steps were checked."""

import numpy as np
import pytest

from mlivr_gym import Box, stance_graph
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.stances.node_table_build import build
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.table_files import TableFiles

BOX = Box.between("crate", "obstacle", (1.5, -0.2, -0.6), (1.9, 0.2, 0.1))


@pytest.fixture(scope="module")
def tracks(jem):
    keep = [point.split(":")[0] in ("D1a", "D2a", "F1b", "F2b", "A1a", "A2b") for point in jem.ids]
    return jem.subset(np.array(keep), "six tracks")


@pytest.fixture
def lazy(tracks, monkeypatch):
    """A graph of which nothing is known, though its table may be in the cache folder."""
    with monkeypatch.context() as patch:
        patch.setattr(TableFiles, "find", lambda *_, **__: None)
        return stance_graph(tracks)


@pytest.fixture(scope="module")
def full(tracks):
    """A graph of which every step was checked."""
    graph = stance_graph(tracks)
    graph.graph_table = build(graph)
    return graph


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
    for limits in ({"options": SearchOptions(limit=1)}, {"time_limit": 0.0}):
        found = Planner(lazy).plan(start, goal, "steps", goal_tolerance=0.05, **limits)
        assert found.reason == "limit reached"
    assert Planner(lazy).plan(start, goal, "steps", goal_tolerance=0.05)


@pytest.mark.parametrize("blocked", [False, True])
def test_steps_are_those_over_all_steps_and_few_are_checked(tracks, lazy, full, blocked):
    if blocked:
        built, full = full.graph_table, stance_graph(tracks)
        full.graph_table = built
        for graph in (lazy, full):
            graph.add_obstacles([BOX])
            graph.occupy([tracks.ids[4], tracks.ids[20]])
    assert full.graph_table.is_exact
    assert not lazy.graph_table.is_exact
    rng, lengths, checked = np.random.default_rng(1), [], []
    for _ in range(25):
        start = random_state(full, rng)
        if start.pose is None and rng.integers(2):  # a limb that held keeps some branches only
            left = full.successors(start)
            start = left.after(start, int(rng.integers(len(left.limb))))
        goal = np.clip(full.base_position[rng.integers(len(full))], *tracks.cabin)
        before = np.count_nonzero(lazy.present.checked_edges.keys >= 0)
        found, truth = (
            Planner(graph).plan(start, goal, "steps", goal_tolerance=0.05) for graph in (lazy, full)
        )
        assert bool(found) == bool(truth), (start, goal)
        assert found.reason == truth.reason
        checked.append(np.count_nonzero(lazy.present.checked_edges.keys >= 0) - before)
        if found:
            lengths.append(len(found.plan.steps))
            assert found.plan.cost == truth.plan.cost
            assert found.plan.statistics.bound == 1.0
    assert max(lengths) > 3
    assert sum(checked) < 0.5 * np.bitwise_count(lazy.table.joined).sum()
