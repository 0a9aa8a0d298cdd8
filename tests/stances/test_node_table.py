"""Tables of nodes against the stance graph: every stance and step, there and back, among boxes."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from compiled import called
from paper import NO_COLLISIONS
from small_tables import small_table

from mlivr_gym import Box, Limb, Settings, State, robot_spec, stance_graph
from mlivr_gym.compiled import kernels
from mlivr_gym.compiled.limb_branch_sets import unpacked
from mlivr_gym.postures.base_poses import bases_at
from mlivr_gym.postures.postures import FIELDS
from mlivr_gym.postures.relabelling import is_symmetric_after_relabelling, relabelled
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.graph_table import GraphTable
from mlivr_gym.stances.node_edges import (
    branches_lost,
    edge_ends,
    every_edge,
    kept_by_table,
)
from mlivr_gym.stances.node_table import ROUNDED
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import step_tables
from mlivr_gym.stances.table_build import build_table, find_table


@pytest.fixture(scope="module", params=[(3, False), (4, True)])
def known(request):
    """Of limbs that are alike, and that differ."""
    return small_table(*request.param)


@pytest.fixture(scope="module")
def graph(known):
    return known[0]


@pytest.fixture(scope="module")
def table(known):
    return known[1]


def is_set(bits, k):
    word, place = divmod(int(k), 64)
    return bool(int(bits[word]) >> place & 1)


def test_it_has_every_node_and_what_the_graph_says_of_it(graph, table):
    limbs = graph.limbs
    every = np.array(list(itertools.permutations(range(len(graph.grasp_map)), limbs)))
    every = every[
        [all(graph.compatible[a, b] for a, b in itertools.combinations(s, 2)) for s in every]
    ]
    postures = graph.nodes(every)
    nodes = graph.is_node(postures)
    rows, relabellings = table.find(every, graph.robot)
    np.testing.assert_array_equal(rows >= 0, nodes)
    assert nodes.sum() > 100
    every, postures, rows, relabellings = (
        every[nodes],
        postures.take(nodes),
        rows[nodes],
        relabellings[nodes],
    )
    np.testing.assert_array_equal(relabelled(every, relabellings), table.points[rows])
    away = np.linalg.norm(table.base_position[rows] - postures.base_position, axis=1)
    assert away.max() < ROUNDED
    for mine, theirs in (
        (table.branch_sets, postures.branch_sets),
        (table.releasable, graph.all_releases(every, postures)["branches"]),
        (table.folds, graph.all_releases(every, postures)["folds"]),
    ):
        np.testing.assert_array_equal(unpacked(mine[rows], limbs), relabelled(theirs, relabellings))
    if is_symmetric_after_relabelling(graph.robot):
        assert len(set(rows.tolist())) * limbs == len(rows)


def kept_at_most(graph, table, bits):
    """What limbs may keep on steps there or back, and what both nodes have, each (k, N - 1)."""
    limbs, branch_sets = graph.limbs, unpacked(table.branch_sets, graph.limbs)
    points = table.points.astype(np.int64)
    (a, i), (b, j), _ = edge_ends(table, bits)
    stances = points[a], relabelled(points[b], j - i)
    postures = tuple(map(graph.nodes, stances))
    shared = relabelled(branch_sets[a], i + 1)[:, :-1] & relabelled(branch_sets[b], j + 1)[:, :-1]
    both, count = graph.checks.stances(np.concatenate(stances), join(*postures)), len(bits)
    graph._check_releases(both, np.indices(both.points.shape).reshape(2, -1).T)
    kept = np.zeros((count, limbs - 1), dtype=np.int64)
    rows = np.flatnonzero((a != b) & shared.all(axis=1))
    for one, other in ((0, count), (count, 0)):
        steps = graph.checks.steps(both, rows + one, rows + other)
        graph.checks.relax(steps, both, graph.checks.world(None))
        found = relabelled(steps["kept"][:, :limbs], i[rows] + 1)[:, :-1]
        kept[rows] |= found * found.all(axis=1)[:, None]
    return kept, shared


def assert_kept(graph, table, bits):
    """That the table tells the same; how many of the pairs a step may join."""
    kept, shared = kept_at_most(graph, table, bits)
    joined = np.array([is_set(table.joined, bit) for bit in bits.tolist()])
    np.testing.assert_array_equal(joined, kept.all(axis=1))
    loses_branches = 0
    for these in (bits, edge_ends(table, bits)[2]):
        lost = np.array([called(branches_lost)(table, int(bit)) for bit in these], dtype=np.uint64)
        told = unpacked(lost, table.limbs - 1)
        np.testing.assert_array_equal(told[joined], (shared & ~kept)[joined])
        assert not lost[~joined].any()
        loses_branches += (lost != 0).sum()
    assert loses_branches
    assert 5 < joined.sum() < len(bits)


def test_what_steps_keep_at_most_is_what_they_may_keep_there_or_back(graph, table):
    """Of all pairs, those among them that no step joins."""
    bits = np.arange(int(table.offset[-1]))
    assert_kept(graph, table, np.random.default_rng(1).permutation(bits)[:4000])


def test_steps_are_the_same_with_the_table(graph, table):
    """From states on all branches and on few, with all points free or not."""
    known, rng, found = stance_graph(graph.grasp_map, graph.robot), np.random.default_rng(6), 0
    known.graph_table = GraphTable(table, False)
    for trial in range(60):
        state = random_state(graph, rng)
        if trial % 3 == 1:
            branch_sets = tuple(
                branch_set & int(rng.integers(1, 1 << 16)) or branch_set
                for branch_set in state.branch_sets
            )
            state = state._replace(branch_sets=branch_sets)
        occupied = rng.choice(len(graph.grasp_map), 2, replace=False) if trial % 3 == 2 else []
        for one in (graph, known):
            one.occupy(np.array(occupied, dtype=np.int64).tolist())
        for mine, theirs in zip(known.successors(state), graph.successors(state), strict=True):
            np.testing.assert_allclose(mine, theirs, atol=1e-12, rtol=0)
            assert mine.dtype == theirs.dtype
        found += len(theirs)
        for one in (graph, known):
            one.vacate(np.array(occupied, dtype=np.int64).tolist())
    assert found > 60
    pose = (*graph.posture_of(state).base_position[0] + 0.01, 1.0, 0.0, 0.0, 0.0)
    given = state._replace(pose=pose)
    for mine, theirs in zip(known.successors(given), graph.successors(given), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("robot", ["mlivr3", "mlivr4"])
def test_the_table_that_ships_is_that_of_the_graph(robot):
    """Of some nodes all that is told, and that all their steps are among the bits."""
    graph, with_table = (stance_graph(robot=robot) for _ in range(2))
    limbs, rng = graph.limbs, np.random.default_rng(4)
    table = find_table(with_table)[1].nodes
    rows = rng.choice(len(table.points), 150, replace=False)
    stances = table.points[rows].astype(np.int64)
    postures = graph.nodes(stances)
    assert graph.is_node(postures).all()
    away = np.linalg.norm(table.base_position[rows] - postures.base_position, axis=1)
    assert away.max() < 10.0 * ROUNDED
    bases = bases_at(
        graph.grasp_map, graph.robot, stances, table.pose_number[rows].astype(np.int64)
    )
    np.testing.assert_allclose(bases[0], postures.base_position, atol=1e-12, rtol=0)
    np.testing.assert_allclose(bases[1], postures.base_rotation, atol=1e-12, rtol=0)
    releases = graph.all_releases(stances, postures)
    for mine, theirs in (
        (table.branch_sets, postures.branch_sets),
        (table.releasable, releases["branches"]),
        (table.folds, releases["folds"]),
    ):
        np.testing.assert_array_equal(unpacked(mine[rows], limbs), theirs)
    orders = np.array(list(itertools.permutations(range(limbs))))
    others = np.array([[*s[:-1], rng.choice(graph.partners(s[0]))] for s in stances[:30].tolist()])
    others = others[[len(set(s)) == limbs for s in others.tolist()]][:, orders].reshape(-1, limbs)
    there = table.find(others, graph.robot)[0] >= 0
    np.testing.assert_array_equal(there, graph.is_node(graph.nodes(others)))
    assert 0 < there.sum() < len(others)
    steps = 0
    for stance, branch_sets in zip(
        stances[:10].tolist(), postures.branch_sets.tolist(), strict=False
    ):
        state = State(tuple(stance), tuple(branch_sets))
        found, told = graph.successors(state), with_table.successors(state)
        for name in ("limb", "point", "branch_sets"):
            np.testing.assert_array_equal(getattr(told, name), getattr(found, name))
        np.testing.assert_allclose(told.base_position, found.base_position, atol=1e-12, rtol=0)
        steps += len(found.limb)
    assert steps > 100
    assert_kept(graph, table, rng.integers(0, int(table.offset[-1]), 300))


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
    assert_same_steps(grown, fresh)
    grown.remove_obstacles([box.id for box in boxes[::2]])
    fresh = stance_graph(few)
    fresh.add_obstacles(boxes[1::2])
    fresh.occupy([0, 5])
    assert_same_steps(grown, fresh)
    grown.remove_obstacles()
    grown.vacate()
    assert_same_steps(grown, stance_graph(few))


def assert_same_steps(graph, other):
    ours, theirs = step_tables(graph), step_tables(other)
    for name, one, their in zip(ours._fields, ours, theirs, strict=True):
        np.testing.assert_array_equal(one, their, err_msg=name)


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
