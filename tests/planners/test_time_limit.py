"""Time limits are kept, on a slow machine and while something is worked out once."""

import math
import sys
import threading
import time
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial

import numpy as np
import pytest
from small_tables import small_map, small_table
from time_limit import AGES

from mlivr_gym import Box, Settings, jem_map, stance_graph
from mlivr_gym.compiled import kernels
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.motion import commitment
from mlivr_gym.planners import (
    Planner,
    SearchOptions,
    backward_search,
    label_search,
    lower_bounds,
    searches,
)
from mlivr_gym.planners.building import result_by_deadline
from mlivr_gym.planners.clock import PIECE, Clock, OutOfTime
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.table_build import build_table

SECONDS = {
    "check_all": 2e-2,
    "check_supports": 2e-2,
    "release_all": 2e-2,
    "solve_all": 2e-2,
    "<lambda>": 4e-4,  # the kernels of fewest steps
}
"""Time that a slow machine takes for an item of each kernel that is called in threads [s]."""

OTHERWISE, LABEL, SETTLED, SWING = 8e-3, 3e-2, 4e-3, 0.1
"""The same for other kernels, a label or a node of a search, and a step's swing."""

OVERRUN = 0.2
"""Time by which a limit may be exceeded [s]."""


class SlowMachine:
    """A machine whose clock is moved by the work that is done, and by nothing else.

    `longest` is the longest time for which kernels were called in threads without a look at it.
    """

    def __init__(self, monkeypatch):
        self.now, self.worked, self.stored = 0.0, set(), {}
        self.unseen, self.longest = 0.0, 0.0
        patch = monkeypatch.setattr
        patch(time, "perf_counter", self._read)
        for module in (searches, lower_bounds):
            patch(module, "result_by_deadline", self._result_by_deadline)
        run = kernels.in_parallel

        def in_parallel(count, kernel, *args, **options):
            took = count * SECONDS.get(kernel.__name__, OTHERWISE)
            self.work(kernel.__name__, took)
            self.unseen += took
            run(count, kernel, *args, **options)

        for name, module in list(sys.modules.items()):
            if name.startswith("mlivr_gym.") and vars(module).get("in_parallel") is run:
                patch(module, "in_parallel", in_parallel)
        self._count(
            patch, label_search, "_search", LABEL, lambda graph, h, status, *_: status["expanded"]
        )
        self._count(
            patch, backward_search, "_search", SETTLED, lambda *given: given[2]["closed"].sum()
        )
        commit = commitment.commit
        patch(commitment, "commit", lambda *given: self.work("commit", SWING) or commit(*given))
        patch(commitment.CommittedSteps, "step_time", 0.05)  # which is learned, and then forgotten

    def _read(self):
        self.longest, self.unseen = max(self.longest, self.unseen), 0.0
        return self.now

    def _result_by_deadline(self, key, work, deadline):
        """Work in a thread that goes on after the deadline, when nobody waits for it any more."""
        began = self.now
        found = self.stored.pop(key) if key in self.stored else work()
        self.unseen = 0.0  # who waits looks at the clock
        if self.now > deadline:
            self.now, self.stored[key] = max(began, deadline), found
            raise OutOfTime
        return found

    def work(self, kind, seconds):
        """Some work takes its time."""
        self.now += seconds
        self.worked.add(kind)

    def planned(self, planner, given, limit, **how):
        """Plan under a limit [s], which is kept; return how long it took."""
        began = self.now
        found = planner.plan(*given, goal_tolerance=0.05, time_limit=limit, **how)
        assert found.plan is not None or found.reason == "limit reached"
        assert self.now - began <= limit + OVERRUN
        return self.now - began

    def _count(self, patch, module, name, seconds, done):
        """Let a search take time for each item that it counts."""
        run = getattr(module, name)

        def counted(*given):
            before = done(*given)
            end = run(*given)
            self.work(f"{module.__name__}.{name}", seconds * float(done(*given) - before))
            return end

        patch(module, name, counted)


def among_obstacles(graph, base_positions):
    """The graph, with a box beside its nodes."""
    graph.remove_obstacles()
    centre = base_positions.mean(axis=0) + np.array([0.0, 0.5, 0.0])
    graph.add_obstacles([Box.between("box", "obstacle", centre - 0.3, centre + 0.3)])
    return graph


def over_a_table(limbs):
    graph, table = small_table(limbs)
    return among_obstacles(graph, table.base_position)


def near_map():
    """More points of the JEM."""
    jem = jem_map()
    near = (np.abs(jem.positions[:, 0] - 2.3) < 0.5) & (np.arange(len(jem)) % 2 == 0)
    return jem.subset(near, "near")


def without_a_table():
    return stance_graph(near_map(), "mlivr3")


def unknown_steps():
    return stance_graph(near_map(), settings=Settings(limb_threshold=0.05))


@cache
def known_steps():
    graph = stance_graph(near_map())
    build_table(graph)
    return graph


@pytest.fixture(scope="module", autouse=True)
def known_steps_go_with_this_file():
    yield
    known_steps.cache_clear()


def two_limbs_among_obstacles():
    return among_obstacles(unknown_steps(), small_table(2)[1].base_position)


CASES = {
    "two limbs, steps known": known_steps,
    "table of three limbs, obstacles": lambda: over_a_table(3),
    "three limbs without a table": without_a_table,
    "two limbs, obstacles": two_limbs_among_obstacles,
}
"""Graphs whose searches work in all ways that there are."""


def query(graph, cost):
    """A start, and a goal that is as far as a plan leads, without a limit."""
    seed = 4 if graph.obstacles and graph.limbs == 2 else 2
    rng, best, found = np.random.default_rng(seed), 0, None
    start = random_state(graph, rng)
    for _ in range(12):
        goal = graph.posture_of(random_state(graph, rng)).base_position[0].tolist()
        plan = Planner(graph).plan(start, goal, cost, goal_tolerance=0.05).plan
        if plan is not None and len(plan.steps) > best:
            best, found = len(plan.steps), (start, goal, cost)
    return found


@pytest.mark.parametrize(
    ("case", "cost", "method"),
    [
        *((case, "base", "astar") for case in CASES),
        ("two limbs, obstacles", "steps", "astar"),
        ("two limbs, steps known", "base", "dijkstra"),
    ],
)
def test_a_limit_is_kept_on_a_slow_machine(case, cost, method, monkeypatch):
    """Wherever in the search it ends: in bounds, among nodes, edges, postures or labels."""
    graph = CASES[case]()
    given = query(graph, cost)
    machine, whole = SlowMachine(monkeypatch), 0.0
    exact = SearchOptions(inflation=1.0, method=method)
    for share in (None, *np.linspace(0.04, 0.94, 7).tolist()):
        fresh = CASES[case]() if graph.table is None or graph.limbs == 2 else graph
        limit, machine.unseen = 1e9 if share is None else share * whole, 0.0
        took = machine.planned(Planner(fresh), given, limit, options=exact)
        whole = whole or took
    graph.remove_obstacles()
    assert machine.longest <= OVERRUN  # wherever a limit ends
    assert whole > 2.0 * OVERRUN


def test_a_limit_is_kept_while_postures_are_computed(monkeypatch):
    """Where each takes a tenth of a second, as for a robot with numeric inverse kinematics."""
    monkeypatch.setitem(SECONDS, "solve_all", 0.1)
    given = query(without_a_table(), "base")
    machine = SlowMachine(monkeypatch)
    for limit in (0.5, 1.0, 2.0, 4.0):
        machine.planned(Planner(without_a_table()), given, limit)
    assert "solve_all" in machine.worked


@pytest.mark.parametrize("case", ["two limbs, steps known", "two limbs, obstacles"])
def test_a_limit_is_kept_among_the_first_steps_of_a_given_pose(case, monkeypatch):
    """They are no edges of the table, and are all checked before the search begins."""
    graph = CASES[case]()
    start, goal, cost = query(graph, "steps")
    position, quaternion, _ = graph.configuration(start)
    pose = (*(position + np.array([0.0, 0.0, 0.005])).tolist(), *quaternion.tolist())
    machine, exact = SlowMachine(monkeypatch), SearchOptions(inflation=1.0)
    for limit in (0.2, 0.5, 1.0):
        given = start.stance, goal, cost
        machine.planned(Planner(graph), given, limit, start_pose=pose, options=exact)
    graph.remove_obstacles()


def test_pieces_take_as_long_as_they_should_whatever_an_item_takes(monkeypatch):
    """All items in order, once; what was learned of one kind of work does not hold for another."""
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    clock = Clock(1e9)
    for kind, each in (("dear", 0.5), ("cheap", 1e-6), ("middling", 3e-3), ("dear", 0.5)):
        seen, last = [], 0.0
        for piece in clock.pieces(kind, 5000):
            seen.extend(range(5000)[piece])
            last = each * (piece.stop - piece.start)
            assert last <= max(each, 2.0 * PIECE)
            now[0] += last
        assert seen == list(range(5000))
    assert len(list(Clock().pieces("any", 5000))) == 1
    took = []
    for each in (1e-6, 1e-4):  # as where the machine is given other work
        for piece in clock.pieces("slower", 50_000):
            took.append(each * (piece.stop - piece.start))
            now[0] += took[-1]
    assert max(took[-9:]) <= 2.0 * PIECE
    clock = Clock(now[0] + 1.0)
    seen = clock.pieces("dear", 5000)
    for _ in range(4):
        piece = next(seen)
        now[0] += 0.3 * (piece.stop - piece.start)
    with pytest.raises(OutOfTime):
        next(seen)
    assert now[0] <= clock.deadline + 0.3


def test_work_outlasts_those_who_wait_for_it():
    go, done = threading.Event(), []

    def work():
        go.wait()
        done.append(1)
        return len(done)

    for _ in range(2):
        with pytest.raises(OutOfTime):
            result_by_deadline("work", work, time.perf_counter() + 0.05)
    go.set()
    assert result_by_deadline("work", work, time.perf_counter() + AGES) == 1
    assert result_by_deadline("work", work, math.inf) == 2
    assert done == [1, 1]


@pytest.fixture
def waits(monkeypatch):
    """The times for which threads are waited for."""
    noted, join = [], threading.Thread.join

    def joined(thread, timeout=None):
        noted.append(timeout)
        join(thread, timeout)

    monkeypatch.setattr(threading.Thread, "join", joined)
    return noted


@pytest.mark.parametrize("error", [None, OSError("torn")])
def test_all_threads_that_wait_for_one_work_get_what_came_of_it(waits, error):
    """As planners of equal graphs do, each with its own deadline."""
    go = threading.Event()

    def work():
        go.wait()
        if error is not None:
            raise error
        return "found"

    deadlines = [time.perf_counter() + AGES, math.inf] * 3
    with pytest.raises(OutOfTime):  # it has begun
        result_by_deadline("one", work, time.perf_counter())
    waits.clear()
    pool = ThreadPoolExecutor(len(deadlines))
    jobs = [pool.submit(result_by_deadline, "one", work, one) for one in deadlines]
    while len(waits) < len(jobs):
        time.sleep(0.01)
    go.set()
    assert [job.exception() or job.result() for job in jobs] == [error or "found"] * len(jobs)
    pool.shutdown()


@pytest.fixture
def asked(monkeypatch):
    """A planner of three limbs for which no table is stored, and a query."""
    monkeypatch.setenv(CACHE_VARIABLE, "")
    monkeypatch.setattr("mlivr_gym.stances.table_files._memory", OrderedDict())
    graph = stance_graph(small_map(), "mlivr3")
    start = random_state(graph, np.random.default_rng(0))
    goal = np.clip(graph.posture_of(start).base_position[0] + 0.3, *graph.grasp_map.cabin)
    return partial(Planner(graph).plan, start, goal, "steps", goal_tolerance=0.05)


def test_a_query_ends_in_time_whatever_is_worked_out(asked, waits, monkeypatch):
    """And the next one finds what was worked out meanwhile."""
    calls, go = [], threading.Event()

    def slowly(graph):
        calls.append(graph)
        go.wait()

    monkeypatch.setattr("mlivr_gym.planners.searches.stored_table", slowly)
    result = asked(time_limit=0.5)
    assert result.reason == "limit reached"
    assert "plan again" in result.message
    assert waits
    assert all(0.0 <= seconds <= 0.5 for seconds in waits)
    go.set()
    assert asked(time_limit=AGES).reason != "limit reached"
    assert len(calls) == 1


def test_a_query_with_time_waits_for_what_is_worked_out_for_it(asked):
    """By a thread that needs nothing that the query holds meanwhile."""
    assert asked(time_limit=15.0).reason != "limit reached"
