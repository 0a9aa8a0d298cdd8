"""Searches over the table of all nodes against the plain search of the stance graph."""

import itertools
from contextlib import suppress

import numpy as np
import pytest
from remembered import STEPS, StepsAskedOnce
from small_tables import COSTS, goal_at, searching, small_table

from mlivr_gym import Box, stance_graph
from mlivr_gym.errors import StanceError
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.lower_bounds import LowerBounds
from mlivr_gym.planners.outcome import GOAL_REACHED, LIMIT_REACHED
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.planners.searches import run_search
from mlivr_gym.planners.table_search import TableSearch
from mlivr_gym.stances.random_states import random_state


@pytest.fixture(scope="module", params=[3, 4])
def known(request):
    return small_table(request.param)


@pytest.fixture(scope="module", autouse=True)
def steps_are_forgotten():
    yield
    STEPS.clear()


def optimum(graph, goal, start):
    """The plain search, every step checked, without bounds, table or dominance."""
    found = algorithm1(StepsAskedOnce(graph), start, goal, "zero")
    return found.costs[-1] if found.status == GOAL_REACHED else np.inf


def again(graph):
    """The graph without what was put in its way."""
    graph.remove_obstacles()
    graph.vacate()
    return graph


def compare(graph, goal, start, search):
    """Paths over a table against the plain search on another graph; the last path, if any."""
    found, last = [], None
    for last in search.paths():
        assert goal.reached(last.positions[-1], last.states[-1].stance)
        found.append(search.cost(last))
        for before, after in itertools.pairwise(last.states):
            assert graph.step_to(before, after.stance) == after
    least = optimum(graph, goal, start)
    assert search.lower_bound <= least + 1e-9
    if found:
        assert found == sorted(found, reverse=True)
        assert found[-1] == pytest.approx(least, rel=1e-9)
    else:
        assert not np.isfinite(least)
    return last, search.lower_bound >= min(least - 1e-9, 1e9)


@pytest.mark.parametrize(
    ("limbs", "is_unequal", "cost"),
    [(3, False, COSTS[1]), (4, False, COSTS[2]), (3, True, COSTS[0]), (4, True, COSTS[1])],
)
def test_the_last_walk_is_the_cheapest_of_all(limbs, is_unequal, cost):
    """From nodes and from given poses, all points free or not, to where random steps lead."""
    first, table = small_table(limbs, is_unequal)
    graph, rng = again(first), np.random.default_rng(5)
    compared = proved = longest = 0
    for trial in range(30):
        start = end = random_state(graph, rng)
        for _ in range(4):
            steps = graph.successors(end)
            if len(steps.limb):
                end = steps.after(end, int(rng.integers(len(steps.limb))))
        row = int(table.find(np.array([end.stance]), graph.robot)[0][0])
        goal = goal_at(graph, table, row, cost)
        if trial % 4 == 3:
            base = graph.posture_of(start)
            pose = (*base.base_position[0], *quaternion(base.base_rotation[0]))
            start = graph.state(start.stance, pose)
        if trial % 2:
            free = np.setdiff1d(np.arange(len(graph.grasp_map)), start.stance)
            graph.occupy(rng.choice(free, 2, replace=False).tolist())
        if not goal.reached(graph.posture_of(start).base_position[0], start.stance):
            path, sure = compare(graph, goal, start, searching(LowerBounds(graph), goal, start))
            compared, proved = compared + 1, proved + sure
            longest = max(longest, len(path.states) - 1 if path else 0)
        graph.vacate()
    assert compared > 5
    assert proved > 0.7 * compared
    assert longest > 1


@pytest.mark.parametrize("cost", COSTS)
def test_among_obstacles_and_occupied_points_the_last_walk_is_the_cheapest(known, cost):
    """With obstacles that come after the first search, and go again."""
    first, table = known
    rng, compared, dearer = np.random.default_rng(9), 0, 0
    graph = again(first)
    bounds = LowerBounds(graph)
    for trial in range(6 if table.limbs == 3 else 10):  # of three limbs each takes seconds
        start = random_state(graph, rng)
        goal = goal_at(graph, table, int(rng.integers(len(table.points))), cost, 0.08)
        here = graph.posture_of(start).base_position[0]
        if goal.reached(here, start.stance):
            continue
        free, _ = compare(graph, goal, start, searching(bounds, goal, start))
        centre = here + rng.uniform(0.2, 0.8) * (goal.target - here) + rng.uniform(-0.6, 0.6, 3)
        half = rng.uniform(0.02, 0.07, 3)
        graph.add_obstacles([Box.between("box", "obstacle", centre - half, centre + half)])
        if trial % 2:
            others = np.setdiff1d(np.arange(len(graph.grasp_map)), start.stance)
            graph.occupy(rng.choice(others, 1).tolist())
        try:
            state = graph.state(start.stance)
        except StanceError:
            state = None
        if state is not None:
            search = searching(bounds, goal, state)
            path, _ = compare(graph, goal, state, search)
            compared += path is not None
            if free is not None:
                dearer += path is None or search.cost(path) > search.cost(free) + 1e-9
        graph.remove_obstacles()
        graph.vacate()
    assert compared + dearer > 2
    assert compared


def cut_off(first, table, rng, count, near, plain_search=optimum, **options):
    """Searches that find no path, with a box near the first (0) or last (1) of two nodes.

    Those that prove it are compared with the plain search.
    """
    graph = again(first)
    for _ in range(count):
        ends = rng.integers(len(table.points), size=2)
        half = rng.uniform(0.05, 0.2, 3)
        centre = table.base_position[ends[near]] + rng.uniform(-0.5, 0.5, 3) * (1.0 - 0.4 * near)
        goal = goal_at(graph, table, int(ends[1]), COSTS[0], 0.08)
        graph.add_obstacles([Box.between("box", "obstacle", centre - half, centre + half)])
        with suppress(StanceError):
            state = graph.state(table.points[ends[0]].tolist())
            search = searching(LowerBounds(graph), goal, state, **options)
            if not search.starts_at_goal and not list(search.paths()):
                assert search.lower_bound < np.inf or plain_search(graph, goal, state) == np.inf
                yield search
        graph.remove_obstacles()


@pytest.mark.parametrize(("near", "seed"), [(0, 8), (1, 6)])
def test_a_robot_that_is_shut_in_and_a_goal_that_is_cut_off_are_proved(known, near, seed):
    first, table = known
    found = list(cut_off(first, table, np.random.default_rng(seed), 12, near))
    assert len(found) > 2
    assert all(search.lower_bound == np.inf for search in found)


def test_every_method_and_heuristic_decides_and_keeps_its_bound(known):
    """Without and among obstacles: plans exist or not, and cost what the plain search says."""
    first, table = known
    graph, rng, ends = again(first), np.random.default_rng(21), set()
    bounds = LowerBounds(graph)
    optimal = {"inflation": 1.0}, {"method": "dijkstra"}
    other = {"method": "greedy"}, {"heuristic": "paper"}, {"heuristic": "zero", "inflation": 1.5}
    for trial in range(6 if table.limbs != 3 else 3):
        start = end = random_state(graph, rng)
        for _ in range(2):
            steps = graph.successors(end)
            if len(steps.limb):
                end = steps.after(end, int(rng.integers(len(steps.limb))))
        here = graph.posture_of(start).base_position[0]
        target = graph.posture_of(end).base_position[0]
        goal = Goal.from_arguments(graph, target, *COSTS[trial % 3], 0.05)
        if trial % 2:
            centre = here + rng.uniform(-0.5, 0.5, 3)
            graph.add_obstacles([Box.between("box", "obstacle", centre - 0.06, centre + 0.06)])
            graph.occupy([int(np.setdiff1d(np.arange(len(graph.grasp_map)), start.stance)[0])])
        with suppress(StanceError):
            state = graph.state(start.stance)
            least = optimum(graph, goal, state)
            for kinds in (*optimal, *other):
                query = SearchQuery.from_options(graph, goal, SearchOptions(**kinds))
                found = run_search(TableSearch(bounds, query, state))
                status = None if found is None else found.status
                assert (status == GOAL_REACHED) == np.isfinite(least), kinds
                assert status != LIMIT_REACHED
                ends.add(status == GOAL_REACHED)
                if status == GOAL_REACHED:
                    assert least - 1e-9 <= found.cost <= found.bound * least + 1e-9
                    assert found.bound == 1.0 or kinds in other
        graph.remove_obstacles()
        graph.vacate()
    assert any(ends)


@pytest.mark.parametrize("cost", ["steps", "base"])
def test_the_first_plan_does_not_depend_on_what_was_planned_before(cost):
    """Bounds and checked edges of earlier queries make it sooner, and nothing else."""
    graph = stance_graph(robot="mlivr3")
    start = graph.state(("A6a:1", "A6a:8", "A4b:4"))
    planner, goal = Planner(graph), (2.49, 0.34, 0.66)
    alone = planner.plan(start, goal, cost).unwrap()
    proved = planner.plan(start, goal, cost, options=SearchOptions(effort=300_000)).unwrap()
    assert proved.statistics.cost <= alone.statistics.cost
    again = planner.plan(start, goal, cost).unwrap()
    assert again.stances == alone.stances
    assert again.statistics.cost == alone.statistics.cost
