"""Bounds over all nodes against SciPy, and searches over the table against the plain search."""

import itertools
import time
from contextlib import suppress
from threading import Event

import numpy as np
import pytest
from random_steps import random_walk
from remembered import STEPS, StepsAskedOnce
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from small_tables import COSTS, every_pair, goal_at, searching, small_table
from time_limit import AGES

from mlivr_gym import Box, stance_graph
from mlivr_gym.compiled import kernels
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.errors import StanceError
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.planners import Planner, SearchOptions, building, lower_bounds, table_search
from mlivr_gym.planners.algorithm1 import algorithm1
from mlivr_gym.planners.clock import Clock, OutOfTime
from mlivr_gym.planners.fewest_steps import FORBIDDEN, fewest_steps
from mlivr_gym.planners.lower_bounds import LowerBounds
from mlivr_gym.planners.outcome import GOAL_REACHED, LIMIT_REACHED
from mlivr_gym.planners.query import Goal, SearchQuery
from mlivr_gym.planners.searches import run_search
from mlivr_gym.planners.table_search import TableSearch
from mlivr_gym.stances.random_states import random_state


@pytest.fixture(scope="module", params=[2, 3, 4])
def known(request):
    graph, table = small_table(request.param)
    return graph, table, every_pair(table)


def fresh(known):
    """A graph of its own, to take points of."""
    graph = stance_graph(known[0].grasp_map, known[0].robot)
    graph.graph_table = known[0].graph_table
    return graph


def away(graph, table, cost, row, tolerance=0.06):
    return Goal.from_arguments(graph, table.base_position[row].astype(float), *cost, tolerance)


def lengths(known, goal, taken, ends=None):
    """Least costs to a goal, or some nodes, by SciPy; infinite where nothing leads there."""
    _, table, pairs = known
    places = table.base_position.astype(float)
    free = pairs[~taken[pairs[:, [0, 2]]].any(axis=1)]
    a, b = np.unique(free[:, [0, 2]], axis=0).T
    moved = np.linalg.norm(places[a] - places[b], axis=1)
    # SciPy takes a zero for no edge.
    costs = np.maximum(goal.cost.base_weight * moved + goal.cost.step_weight, 1e-300)
    if ends is None:
        ends = np.flatnonzero((goal.distance(places) <= goal.tolerance) & ~taken)
    if not len(ends):
        return np.full(len(places), np.inf)
    net = csr_array((costs, np.array([b, a], dtype=np.int32)), shape=(len(places), len(places)))
    return dijkstra(net, indices=ends, min_only=True)


@pytest.mark.parametrize("seed", [0, 3])
def test_fewest_steps_are_those_of_scipy(known, seed, monkeypatch):
    """With starts and all nodes that are farther by some steps, in one to four threads."""
    monkeypatch.setattr(kernels, "_cores", lambda: 1 + seed)
    monkeypatch.setattr("mlivr_gym.planners.fewest_steps.LEAST_IN_THREADS", 2)
    graph, table, _ = known
    rng, count = np.random.default_rng(seed), len(table.points)
    taken, goal = rng.random(count) < 0.2 * seed / 3.0, away(graph, table, COSTS[0], 5 + seed)
    goals = goal.distance(table.base_position.astype(float)) <= goal.tolerance
    expected = lengths(known, goal, taken)
    starts = rng.choice(np.flatnonzero(~taken), 2)
    for farther in (0, 1, 1000):
        steps, least = fewest_steps(table, goals, taken, starts, farther)
        assert (steps[taken] == FORBIDDEN).all()
        reached = steps >= 0
        np.testing.assert_array_equal(steps[reached], expected[reached])
        assert (expected[~reached & ~taken] >= least).all()
        if np.isfinite(expected[starts]).all():
            assert reached[starts].all()
            last = expected[starts].max() + farther
            assert steps.max() <= max(last, 1)
            assert farther == 1000 or least <= last + 1
        else:
            assert least == np.inf


@pytest.mark.parametrize("cost", COSTS)
def test_bounds_never_exceed_the_least_cost_whatever_is_taken(known, cost):
    graph, rng, compared = fresh(known), np.random.default_rng(1), 0
    table = known[1]
    for _ in range(12):
        free = rng.choice(len(graph.grasp_map), 1)
        graph.vacate()
        graph.occupy(free.tolist())
        taken = np.isin(table.points, free).any(axis=1)
        goal = away(graph, table, cost, int(rng.integers(len(taken))))
        expected = lengths(known, goal, taken)
        starts = rng.choice(np.flatnonzero(~taken), 1)
        found = LowerBounds(graph).compute(goal, starts)
        assert np.isinf(found.h[taken]).all()
        met = np.isfinite(lengths(known, goal, taken, starts))
        assert (found.h[met] <= np.maximum(expected[met], 1e-12) + 1e-9).all()
        assert ((found.h[met] == 0.0) == (expected[met] == 0.0)).all()
        np.testing.assert_allclose(found.h[found.is_tight], expected[found.is_tight], atol=1e-9)
        if np.isfinite(expected[starts]).all():
            assert found.is_tight[starts].all()
            compared += 1
    assert compared


def test_what_is_learnt_among_obstacles_is_forgotten_with_them(small_map, monkeypatch):
    """After they are gone plans cost what they cost a planner that never saw them."""
    monkeypatch.setattr("mlivr_gym.planners.table_search.MANY", 1)
    graph, rng, dearer = stance_graph(small_map), np.random.default_rng(0), 0
    planner, cost = Planner(graph), "base"
    for trial in range(10):
        start, goal = sample_task(graph, rng, 0.3)
        free = Planner(graph).plan(start.stance, goal, cost).unwrap()
        if trial % 2:  # points that a cheapest plan holds
            graph.occupy([p for p in free.stances[-1] if p not in free.stances[0]])
        else:
            middle = 0.5 * (graph.posture(start.stance).base_position[0] + goal)
            graph.add_obstacles([Box.between("crate", "obstacle", middle - 0.15, middle + 0.15)])
        among = planner.plan(start.stance, goal, cost).plan
        graph.remove_obstacles()
        graph.vacate()
        plan = planner.plan(start.stance, goal, cost).unwrap()
        assert plan.statistics.cost == pytest.approx(free.statistics.cost, abs=1e-9)
        dearer += among is None or among.statistics.cost > free.statistics.cost + 1e-9
    assert dearer > 2


def test_on_the_way_among_more_and_more_boxes_plans_are_those_of_a_new_planner():
    """On a graph that sees all boxes at once; in one turn a box takes the place of all others."""
    graph, other, rng, cost = stance_graph(), stance_graph(), np.random.default_rng(3), "base"
    searched = cut_off = 0
    for _ in range(14):
        planner, (start, goal) = Planner(graph), sample_task(graph, rng, 0.2)
        state, boxes = start, []
        for turn in range(4):
            found = planner.plan(state, goal, cost)
            other.add_obstacles(boxes)
            alone = Planner(other).plan(state, goal, cost)
            other.remove_obstacles()
            assert found.reason == alone.reason
            cut_off += found.plan is None
            if found.plan is None or not found.plan.steps:
                break
            assert found.plan.cost == pytest.approx(alone.plan.cost, abs=1e-9)
            assert found.plan.statistics.bound == 1.0
            searched += found.expanded > 0
            if turn != 1:
                limb, point = found.plan.actions[0]
                moves = graph.successors(state)
                row = moves.find(limb, graph.grasp_map.index(point))
                state = moves.after(state, row)
            here = graph.posture_of(state).base_position[0]
            middle = here + rng.uniform(0.3, 0.9) * (goal - here) + rng.normal(0.0, 0.5, 3)
            half = rng.uniform(0.05, 0.2, 3)
            new = [Box.between(f"box/{turn}", "obstacle", middle - half, middle + half)]
            gone = [box.id for box in boxes] if turn == 2 else []
            graph.add_obstacles(new, replaced=gone)
            if graph.find(state.stance) < 0 or not graph.posture_of(state).branch_sets.all():
                break
            boxes = new if gone else boxes + new
        graph.remove_obstacles()
    assert searched > 11
    assert cut_off


def test_what_was_worked_out_for_bounds_that_are_gone_serves_no_others(monkeypatch):
    """Which may lie in the same place in memory."""
    monkeypatch.setattr(lower_bounds, "id", lambda _: 1, raising=False)
    (first, table), (second, _) = small_table(2), small_table(3)
    goal, starts = away(first, table, COSTS[0], 5), np.array([0])
    with suppress(OutOfTime):
        LowerBounds(first).compute(goal, starts, Clock(0.0))
    for thread in list(building._running.values()):
        thread.join()
    found, truth = (LowerBounds(second).compute(goal, starts) for _ in range(2))
    assert len(found.h) == len(second.table.points)
    np.testing.assert_array_equal(found.h, truth.h)


def test_what_is_known_of_a_goal_does_not_delay_the_proof_that_it_is_cut_off():
    """Bounds from before the points of the goal were occupied lead nearly everywhere."""
    graph, query = stance_graph(), (("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "base")
    planner = Planner(graph)
    assert planner.plan(*query)
    graph.occupy(["O5b:0", "O5b:7"])
    assert Planner(graph).plan(*query).reason == "search exhausted"
    for most in (table_search.WITH_OLD_BOUNDS, 0):
        found = planner.plan(*query)
        assert found.reason == "search exhausted"
        assert found.expanded <= most


def test_bounds_that_are_still_worked_out_are_of_their_own_points(known):
    """A query without time began them; then a point was taken, and the next query asks."""
    graph, table, go = fresh(known), known[1], Event()
    goal, start = away(graph, table, COSTS[0], 7), np.array([7])
    bounds = LowerBounds(graph)
    compute = bounds._compute
    bounds._compute = lambda *given: compute(*given) if go.wait() else None
    with pytest.raises(OutOfTime):
        bounds.compute(goal, start, Clock(0.0))
    point = int(np.setdiff1d(table.points, table.points[7])[0])
    graph.occupy([point])
    go.set()
    found = bounds.compute(goal, start, Clock(time.perf_counter() + AGES))
    assert np.isinf(found.h[(table.points == point).any(axis=1)]).all()


@pytest.fixture(scope="module", params=[3, 4])
def many_limbs(request):
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
        walk = random_walk(graph, rng, 4)
        start, end = walk[0], walk[-1]
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
def test_among_obstacles_and_occupied_points_the_last_walk_is_the_cheapest(many_limbs, cost):
    """With obstacles that come after the first search, and go again."""
    first, table = many_limbs
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


def test_every_method_and_heuristic_decides_and_keeps_its_bound(many_limbs):
    """Without and among obstacles: plans cost what the plain search says, or there is none."""
    graph, rng, ends = again(many_limbs[0]), np.random.default_rng(21), set()
    bounds = LowerBounds(graph)
    optimal = {"inflation": 1.0}, {"method": "dijkstra"}
    other = {"method": "greedy"}, {"heuristic": "paper"}, {"heuristic": "zero", "inflation": 1.5}
    for trial in range(8):
        start = random_state(graph, rng)
        end = random_walk(graph, rng, 2, None if trial % 2 else start)[-1]
        here = graph.posture_of(start).base_position[0]
        target = graph.posture_of(end).base_position[0]
        goal = Goal.from_arguments(graph, target, *COSTS[trial % 3], 0.05)
        if trial % 2:  # a box that may shut the robot in, or cut the goal off
            near = trial // 2 % 2
            centre = (here, target)[near] + rng.uniform(-0.5, 0.5, 3) * (1.0 - 0.4 * near)
            half = rng.uniform(0.05, 0.2, 3)
            graph.add_obstacles([Box.between("box", "obstacle", centre - half, centre + half)])
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
    assert ends == {True, False}


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
