"""Kernels: where they are kept, how many versions a plan needs, and how they run in threads."""

import threading

import numpy as np
import pytest
from processes import printed
from small_tables import small_table

from mlivr_gym import Box, MlivrError, stance_graph
from mlivr_gym.compiled import kernels, limb_branch_sets
from mlivr_gym.compiled.kernels import in_parallel, workers
from mlivr_gym.compiled.records import Record
from mlivr_gym.compiled.scratch import ScratchPool
from mlivr_gym.planners import (
    Planner,
    SearchOptions,
    backward_search,
    fewest_steps,
    label_search,
    table_search,
    table_values,
)
from mlivr_gym.stances import checked_edges, node_edges, node_table
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.transitions import release, steps

ENTRIES = (
    label_search._search, label_search.requeue_checked, backward_search._search,
    fewest_steps._expand_level, checked_edges._put, table_values.compute_costs,
    node_table.find_rows,
    node_edges._set_bits,
    limb_branch_sets.clear_bits, release.release_all, steps.check_all,
)  # fmt: skip


def test_no_plan_needs_a_second_version_of_an_entry(small_map, monkeypatch):
    """Whatever is asked of them the types are the same: nothing is compiled a second time."""
    monkeypatch.setattr(table_search, "MANY", 1)
    before = {one: set(one.signatures) for one in ENTRIES}  # of other tests
    graph = stance_graph(small_map)
    start, goal = graph.ids(graph.points[0]), graph.base_position[-1].tolist()
    box = Box.between("box", "obstacle", (2.0, -0.2, -0.2), (2.1, 0.2, 0.2))
    for boxes in ((), [box]):
        graph.add_obstacles(boxes)
        for cost in ("base", "steps"):
            for heuristic in ("relaxed", "consistent"):
                Planner(graph).plan(start, goal, cost, options=SearchOptions(heuristic=heuristic))
            Planner(graph).cost_to_go(goal, cost)
        graph.successors(graph.state(start))
    three, table = small_table(3)
    start = random_state(three, np.random.default_rng(0))
    three.successors(start)
    Planner(three).plan(start, table.base_position[-1].tolist())
    for one in ENTRIES:
        assert len(one.signatures) >= 1
        assert len(set(one.signatures) - before[one]) <= 1, one


class Room(Record):
    """Scratch of a thread."""

    visits: int


@pytest.mark.parametrize("cores", [1, 3, 64])
@pytest.mark.parametrize("count", [0, 1, 2, 7, 5000])
def test_in_parallel_covers_every_item_once(count, cores, monkeypatch):
    monkeypatch.setattr(kernels, "_cores", lambda: cores)
    seen, made, sizes = np.zeros(count + 3, dtype=int), [], []

    def scratch_rows(number):
        made.append(Room.rows(number))
        return made[-1]

    def visit(start, stop, target, scratch):
        assert scratch.shape == (1,)
        scratch[0]["visits"] += stop - start
        sizes.extend([stop - start] * (stop > start))
        target[start:stop] += 1

    in_parallel(count, visit, seen, scratch_rows=scratch_rows, least=2)
    assert (seen[:count] == 1).all()
    assert (seen[count:] == 0).all()
    (scratch,) = made
    assert len(scratch) == (min(cores, 8) if count >= 2 else 1) == workers(count, 2)
    assert scratch["visits"].sum() == count
    if count >= 2 * cores:
        assert max(sizes) - min(sizes) <= 1


def test_each_thread_has_scratch_of_its_own(monkeypatch):
    """Two threads wait for each other in the middle of each piece of their work."""
    monkeypatch.setattr(kernels, "_cores", lambda: 2)
    meet, found = threading.Barrier(2), []

    def visit(start, stop, scratch):
        if stop > start:
            scratch[0]["visits"] = start + 1
            meet.wait()
            found.append((start + 1, int(scratch[0]["visits"])))

    in_parallel(10, visit, scratch_rows=Room.rows, least=2)
    assert sorted(found) == [(k, k) for k in (1, 2, 3, 4, 6, 7, 8, 9)]


def test_an_error_in_a_thread_is_not_lost(monkeypatch):
    monkeypatch.setattr(kernels, "_cores", lambda: 4)

    def visit(start, stop, scratch):
        if start > 0:
            raise MlivrError("no")

    with pytest.raises(MlivrError, match="no"):
        in_parallel(100, visit, scratch_rows=Room.rows, least=2)


CODE = """
from mlivr_gym.compiled.kernels import config
from mlivr_gym.transitions.rule import can_release
assert can_release(6, 3) and not can_release(6, 1)
print(sum(can_release.stats.cache_hits.values()), sum(can_release.stats.cache_misses.values()))
print(can_release.stats.cache_path)
print(config.CACHE_DIR)
"""


@pytest.mark.parametrize("variable", ["NUMBA_CACHE_DIR", "MLIVR_GYM_CACHE"])
def test_machine_code_is_kept_where_the_environment_says(tmp_path, variable):
    """A folder for Numba goes before ours; it is left as it was for what others compile."""
    kept = {
        "NUMBA_CACHE_DIR": "",
        "MLIVR_GYM_CACHE": tmp_path / "ours",
        variable: tmp_path / "here",
    }
    runs = [printed("-c", CODE, **kept) for _ in range(2)]
    assert [run[0] for run in runs] == ["0 1", "1 0"]
    for _, folder, given in runs:
        assert folder.startswith(str(tmp_path / "here"))
        assert given == (str(tmp_path / "here") if variable == "NUMBA_CACHE_DIR" else "")
    assert not list(tmp_path.glob("ours/*")) or variable != "NUMBA_CACHE_DIR"


class Numbers(Record):
    """Scratch of a test."""

    count: int


def test_two_calls_at_once_have_scratch_of_their_own_and_later_ones_the_same_again():
    pool = ScratchPool(Numbers)
    with pool.borrowed() as one, pool.borrowed() as other:
        one(1)["count"], other(1)["count"] = 1, 2
        assert (one(1)["count"], other(1)["count"]) == (1, 2)
    with pool.borrowed() as again:
        assert again(1)["count"] in (1, 2)
