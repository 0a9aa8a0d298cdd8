"""The table of steps: the same for any number of threads, and in both directions."""

from dataclasses import replace

import numpy as np
import pytest
from paper import NO_COLLISIONS

from mlivr_gym import Box, Limb, Settings, State, robot_spec, stance_graph
from mlivr_gym.compiled import kernels
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.step_tables import step_tables
from mlivr_gym.stances.table_build import fill_rows
from mlivr_gym.stances.two_limb_steps import longest_step


@pytest.fixture(scope="module")
def filled(small_map, cache):
    """All that is known of a small map when it was worked out in some number of threads.

    With a table in the cache nothing would be worked out.
    """

    def fill(threads):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(kernels, "workers", lambda count, least: min(threads, max(count, 1)))
            graph = stance_graph(small_map)
            fill_rows(graph)
        return graph

    return fill


@pytest.fixture(scope="module")
def by_one_thread(filled):
    return filled(1)


def test_any_number_of_threads_gives_the_same_to_the_last_bit(filled, by_one_thread):
    alone, many = by_one_thread, filled(5)
    assert alone.base_position.tobytes() == many.base_position.tobytes()
    assert alone.w_m.tobytes() == many.w_m.tobytes()
    np.testing.assert_array_equal(alone.steps.edges, many.steps.edges)
    np.testing.assert_array_equal(alone.steps.releases, many.steps.releases)


def test_a_step_is_the_same_in_both_directions(by_one_thread):
    graph = by_one_thread
    known = graph._known
    for held in range(2):
        for point in np.unique(graph.points[:, held]):
            before, after = graph.edges_of_row(held, int(point))
            forth = known.table.edges[known.index(held, before, after)]
            back = known.table.edges[known.index(held, after, before)]
            assert np.array_equal(forth["kept"], back["kept"])


def test_the_longest_step_of_a_row_is_that_of_all_its_pairs(small_graph):
    graph, longest = small_graph, 0.0
    for held in range(2):
        out = np.zeros(len(graph.grasp_map))
        longest_step(held, graph.steps.rows, graph.steps.row_start, graph.base_position, out)
        for point in range(len(out)):
            places = graph.base_position[graph.points[:, held] == point]
            between = places[:, None] - places[None]
            assert out[point] == pytest.approx((between**2).sum(axis=2).max(initial=0.0))
        longest = max(longest, float(np.sqrt(out.max())))
    assert graph.max_displacement == pytest.approx(longest)


def test_what_was_checked_among_fewer_obstacles_is_what_is_found_among_all(small_map):
    """Boxes come one by one, each asked about at once, against a graph that has them all."""
    few = small_map.subset(np.arange(len(small_map)) % 3 > 0, "few")
    grown, rng = stance_graph(few), np.random.default_rng(3)
    low, high = grown.base_position.min(axis=0), grown.base_position.max(axis=0)
    boxes = []
    for k in range(10):
        centre, half = rng.uniform(low, high), rng.uniform(0.02, 0.1, 3)
        boxes.append(Box.between(f"b{k}", "obstacle", centre - half, centre + half))
        grown.add_obstacles(boxes[-1:])
        if k == 2:
            grown.occupy([0, 5])
        for held in range(2):
            for point in rng.permutation(np.unique(grown.points[:, held]))[:12].tolist():
                before, after = grown.edges_of_row(held, point)
                grown.check_steps(np.full_like(before, held), before, after)
    fresh = stance_graph(few)
    fresh.add_obstacles(boxes)
    fresh.occupy([0, 5])
    ours, theirs = step_tables(grown), step_tables(fresh)
    for name, one, other in zip(ours._fields, ours, theirs, strict=True):
        np.testing.assert_array_equal(one, other, err_msg=name)


def test_releases_among_boxes_that_come_one_by_one_are_those_among_all(small_map):
    """Against a graph that has all boxes from the start; some open another branch."""
    few = small_map.subset(np.arange(len(small_map)) % 3 > 0, "few")
    grown, rng, gained = stance_graph(few), np.random.default_rng(3), []
    every = np.stack(np.divmod(np.arange(2 * len(grown)), 2), axis=1)
    low, high = grown.base_position.min(axis=0), grown.base_position.max(axis=0)
    for trial in range(3):
        grown.remove_obstacles()
        boxes, before = [], None
        for k in range(5):
            centre, half = rng.uniform(low, high), rng.uniform(0.02, 0.15, 3)
            boxes.append(Box.between(f"b{trial}{k}", "obstacle", centre - half, centre + half))
            grown.add_obstacles(boxes[-1:])
            fresh = stance_graph(few)
            fresh.add_obstacles(boxes)
            for graph in (grown, fresh):
                graph.check_releases(every)
            now = fresh.releasable.copy()
            np.testing.assert_array_equal(grown.releasable, now)
            if before is not None:
                gained.append(bool((now & ~before)[before != 0].any()))
            before = now
    assert min(gained.count(True), gained.count(False)) >= 3


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
        ("mlivr2", NO_COLLISIONS),
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
    tables, implicit = step_tables(graph), ImplicitGraph(small_map, graph.robot, settings)
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
            assert graph.edge(state, after, both) == implicit.edge(state, after, both)
    assert count > 50


def test_narrow_joint_limits_take_steps_away(small_map):
    wide, narrow = (len(step_tables(stance_graph(small_map, robot, NO_COLLISIONS)).after)
                    for robot in (WIDE, NARROW))  # fmt: skip
    assert 0 < narrow < wide
