"""The table of two limbs: the same for any number of threads, in both directions, among boxes."""

from dataclasses import replace

import numpy as np
import pytest
from compiled import called
from paper import NO_COLLISIONS
from small_tables import small_table

from mlivr_gym import Box, Limb, Settings, State, robot_spec, stance_graph
from mlivr_gym.compiled import kernels
from mlivr_gym.compiled.limb_branch_sets import supports_of
from mlivr_gym.postures.postures import FIELDS
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.node_edges import (
    branches_lost,
    edge_ends,
    every_edge,
    kept_by_table,
    with_kept,
)
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import step_tables
from mlivr_gym.stances.table_build import build_table


@pytest.fixture(scope="module")
def filled(small_map, cache):
    """All that is known of a small map when it was worked out in some number of threads.

    With a table in the cache nothing would be worked out.
    """

    def fill(threads):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(kernels, "workers", lambda count, least: min(threads, max(count, 1)))
            graph = stance_graph(small_map)
            build_table(graph)
        return graph

    return fill


@pytest.fixture(scope="module")
def by_one_thread(filled):
    return filled(1)


def tables_of(graph):
    """All arrays of a table that was built."""
    known = graph.graph_table
    return [*known.nodes, *(getattr(known.listed.postures, name) for name in FIELDS)]


def test_any_number_of_threads_gives_the_same_to_the_last_bit(filled, by_one_thread):
    alone, many = by_one_thread, filled(5)
    for one, other in zip(tables_of(alone), tables_of(many), strict=True):
        assert one.tobytes() == other.tobytes()
    ours, theirs = (one.listed.releases for one in (alone, many))
    np.testing.assert_array_equal(ours, theirs)


def test_a_step_is_the_same_in_both_directions(by_one_thread):
    table = by_one_thread.table
    edges = every_edge(table)
    np.testing.assert_array_equal(
        kept_by_table(table, edges), kept_by_table(table, edge_ends(table, edges)[2])
    )


@pytest.mark.parametrize("limbs", [2, 3, 4])
def test_what_edges_keep_is_what_both_nodes_have_but_for_what_is_lost(limbs):
    """Against the kernels, and written back."""
    table = small_table(limbs)[1]
    bits = np.random.default_rng(2).permutation(int(table.offset[-1]))[:3000]
    kept, edges = kept_by_table(table, bits), set(every_edge(table).tolist())
    (before, i), (after, j), _ = edge_ends(table, bits)
    for k, bit in enumerate(bits.tolist()):
        of = called(supports_of)
        a = of(table.branch_sets[before[k]], int(i[k]), limbs)
        b = of(table.branch_sets[after[k]], int(j[k]), limbs)
        lost = called(branches_lost)(table, bit)
        assert kept[k] == (a & b & ~lost if bit in edges else 0)
    assert np.count_nonzero(kept) > 20
    again = with_kept(table, every_edge(table), kept_by_table(table, every_edge(table)))
    for one, other in zip(again, table, strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_longest_step_is_that_of_all_pairs_that_share_a_point(small_graph):
    graph, longest = small_graph, 0.0
    for held in range(2):
        for point in range(len(graph.grasp_map)):
            places = graph.base_position[graph.points[:, held] == point]
            between = places[:, None] - places[None]
            longest = max(longest, float((between**2).sum(axis=2).max(initial=0.0)))
    assert graph.max_displacement == pytest.approx(longest**0.5)


@pytest.mark.parametrize("built", [False, True])
def test_what_was_checked_among_fewer_obstacles_is_what_is_found_among_all(small_map, built):
    """Boxes come one by one, each asked about at once, against a graph that has them all."""
    few = small_map.subset(np.arange(len(small_map)) % 3 > 0, "few")
    grown, rng = stance_graph(few), np.random.default_rng(3)
    if built:
        build_table(grown)
    low, high = grown.base_position.min(axis=0), grown.base_position.max(axis=0)
    boxes = []
    for k in range(10):
        centre, half = rng.uniform(low, high), rng.uniform(0.02, 0.1, 3)
        boxes.append(Box.between(f"b{k}", "obstacle", centre - half, centre + half))
        grown.add_obstacles(boxes[-1:])
        if k == 2:
            grown.occupy([0, 5])
        edges = rng.permutation(every_edge(grown.table))[:200]
        grown.present.look(edges)
        seen = edges[grown.present.checked_edges.contains(edges)]
        assert len(seen) or not built
        most = grown.present.checked_edges.kept_on(seen)
        grown.present.kept(edges)
        assert not (grown.present.kept(seen) & ~most).any()
    fresh = stance_graph(few)
    fresh.add_obstacles(boxes)
    fresh.occupy([0, 5])
    ours, theirs = step_tables(grown), step_tables(fresh)
    for name, one, other in zip(ours._fields, ours, theirs, strict=True):
        np.testing.assert_array_equal(one, other, err_msg=name)
    grown.remove_obstacles()
    grown.vacate()
    for one, other in zip(step_tables(grown), step_tables(stance_graph(few)), strict=True):
        np.testing.assert_array_equal(one, other)


LIMITS, STARTS = ((-2.7, 2.7),) * 6, (-2.7,) * 6
WIDE, NARROW = (
    replace(robot_spec("mlivr2"), limb=limb)
    for limb in (Limb(window_starts=STARTS), Limb(joint_limits=LIMITS, window_starts=STARTS))
)


def steps_of(found):
    """Branch sets after each step, by limb and point."""
    return {
        (int(limb), int(point)): tuple(branch_sets.tolist())
        for limb, point, branch_sets in zip(found.limb, found.point, found.branch_sets, strict=True)
    }


@pytest.mark.parametrize(
    ("robot", "settings"),
    [
        (WIDE, NO_COLLISIONS),
        (NARROW, NO_COLLISIONS),
        ("mlivr2", Settings(collisions=False, transitions=False)),
        ("mlivr2", Settings(collisions=False, manipulability=False)),
        ("mlivr2", Settings()),
    ],
)
def test_steps_of_tables_are_those_that_leave_the_states_of_the_graph(small_map, robot, settings):
    """Asked one stance at a time."""
    graph = stance_graph(small_map, robot, settings)
    tables, implicit = step_tables(graph), StanceGraph(small_map, graph.robot, settings)
    count = 0
    for s in np.random.default_rng(1).integers(0, len(graph), 12):
        state = State(tuple(graph.points[s].tolist()), tuple(graph.branch_sets[s].tolist()))
        found = graph.successors(state)
        ours, truth = steps_of(found), steps_of(implicit.successors(state))
        assert steps_of(tables.successors(int(s), state.branch_sets)) == ours
        assert ours == truth
        count += len(ours)
        for k in range(0, len(found.limb), 9) if not settings.transitions else ():
            after = found.after(state, k).stance
            both = join(graph.posture(state.stance), graph.posture(after))
            ours = graph.kept_on_step(state, after, both)
            assert ours == implicit.kept_on_step(state, after, both)
    assert count > 50
