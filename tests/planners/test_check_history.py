"""The order that results of checks give to the open queue, and the nodes that are checked next."""

import itertools

import numpy as np
import pytest
from small_tables import goal_at, searching, small_table_with_box

from mlivr_gym.planners import check_history, label_search, search_stages, table_search
from mlivr_gym.planners.check_history import CheckHistory, closest
from mlivr_gym.planners.costs import Cost, cost_weights
from mlivr_gym.planners.label_search import SearchGraph
from mlivr_gym.planners.lower_bounds import LowerBounds
from mlivr_gym.stances.obstacles import CELL_EDGE
from mlivr_gym.stances.random_states import random_state


@pytest.fixture(params=[3, 4])
def graph(request):
    """A graph on a few points with a box, which goes after the test."""
    with small_table_with_box(request.param, 0.04) as found:
        yield found


def test_nodes_close_to_a_failure_come_later_and_those_at_steps_earlier(graph):
    lazy_table = LowerBounds(graph).lazy_table
    base = lazy_table.table.base_position
    rng, h = np.random.default_rng(0), np.full(len(base), 7.0)
    failed, goal, *at_step = rng.choice(len(base), 4, replace=False).tolist()
    h[goal] = 0.0
    history = CheckHistory(lazy_table)
    steps = Cost.named("steps")
    plain = SearchGraph(lazy_table.table, lazy_table.checked_edges, cost_weights(steps))

    def ordered():
        found = history.ordered(plain, steps)
        keys = found.delays.added_to(h, np.arange(len(h)))
        assert [label_search._estimate.py_func(found, h, s) for s in range(len(h))] == keys.tolist()
        return keys

    assert (ordered() == h).all()
    history.add_failures(np.array([failed, failed]))
    history._place[at_step] = len(history._penalty)
    keys = ordered()
    others = np.setdiff1d(np.arange(len(base)), [goal, *at_step])
    late = keys[others] - 7.0
    expected = 2 * 0.5 * (1.0 - np.linalg.norm(base[others] - base[failed], axis=1) / 0.25)
    slack = CELL_EDGE * np.sqrt(3.0) / 2.0 / 0.25
    assert np.abs(late - np.maximum(expected, 0.0)).max() <= slack
    assert late.max() > 0.5
    assert (late >= 0.0).all()
    assert (keys[at_step] == 6.0).all()
    assert keys[goal] == 0.0
    assert history.relax()
    halved = ordered()
    np.testing.assert_allclose(halved[others] - 7.0, late / 2.0, atol=1e-12)


def test_the_closest_unchecked_nodes_are_checked(graph, monkeypatch):
    monkeypatch.setattr(check_history, "NODES_CHECKED_AROUND", 20)
    lazy_table = LowerBounds(graph).lazy_table
    base, rng = lazy_table.table.base_position, np.random.default_rng(1)
    touching = rng.choice(len(base), 3, replace=False)
    some = np.sort(rng.choice(len(base), len(base) // 2, replace=False))
    lazy_table.check_nodes(some[: len(some) // 2])
    free = some[lazy_table.is_unchecked[some]]
    apart = np.linalg.norm(base[free][:, None] - base[touching], axis=2).min(axis=1)
    chosen = closest(lazy_table, some, touching)
    assert lazy_table.is_unchecked[chosen].all()
    assert len(chosen) == min(20, len(free))
    taken = np.linalg.norm(base[chosen][:, None] - base[touching], axis=2).min(axis=1)
    np.testing.assert_allclose(np.sort(taken), np.sort(apart)[: len(chosen)])


def test_a_first_path_is_found_by_this_order_alone(graph, monkeypatch):
    """Its steps are those of the graph, and it proves nothing."""
    stage = search_stages.FIRST_PATH_AMONG_OBSTACLES
    monkeypatch.setattr(table_search, "OBSTACLE_STAGES", (stage,) * 2)
    monkeypatch.setattr(table_search, "QUICK_FIRST_PATH_AMONG_OBSTACLES", stage)
    rng, bounds, found = np.random.default_rng(5), LowerBounds(graph), 0
    for _ in range(40):
        start, table = random_state(graph, rng), graph.table
        goal = goal_at(graph, table, int(rng.integers(len(table.points))), ("steps", None))
        search = searching(bounds, goal, start)
        if search.starts_at_goal:
            continue
        for path in search.paths():
            found += 1
            assert goal.reached(path.positions[-1], path.states[-1].stance)
            for before, after in itertools.pairwise(path.states):
                assert graph.step_to(before, after.stance) == after
    assert found > 2
