"""Check that walks of valid steps can be executed and plans are optimal; parts of `truth.py`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np
from reports import study_rows, two_limb_graph
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from tqdm import tqdm

from mlivr_gym import GraspMap, jem_map, stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.motion.commitment import committed_motion
from mlivr_gym.planners import Cost, Planner, SearchOptions, plan_of
from mlivr_gym.settings import Settings
from mlivr_gym.simulation import Setup, StepExecutor, execute
from mlivr_gym.stances import StanceGraph, State, random_state
from mlivr_gym.stances.step_tables import step_tables

STEPS = 10
"""Steps of a random walk."""

COSTS = (("base", None), ("steps", None), ("weighted", 0.2))
"""Costs of the queries, with the price of a regrasp [m]."""


@cache
def whole_graph() -> StanceGraph:
    """Return the stance graph of the JEM with all steps known, once per process."""
    graph = two_limb_graph()
    step_tables(graph)
    return graph


def random_walk(graph: StanceGraph, rng: np.random.Generator, steps: int = STEPS) -> list[State]:
    """Return the states of a walk of random valid steps."""
    states = [random_state(graph, rng)]
    for _ in range(steps):
        steps_from = graph.successors(states[-1])
        if not steps_from:
            break
        states.append(steps_from.after(states[-1], int(rng.integers(len(steps_from.limb)))))
    return states


def walk(task: int) -> dict[str, Any]:
    """Return whether a random walk has all its steps and a motion, and its swing kinds."""
    graph = whole_graph()
    states = random_walk(graph, np.random.default_rng([1, task]))
    motion = committed_motion(graph, states).motion
    swings = [step.swing for step in motion.steps] if motion else []
    return {"whole": len(states) == STEPS + 1, "motion": motion is not None, "swings": swings}


def executed_walk(task: int) -> dict[str, Any]:
    """Return how a random walk ends in the simulation, and its number of steps."""
    graph = whole_graph()
    states = random_walk(graph, np.random.default_rng([2, task]))
    plan = plan_of(graph, states, np.zeros(3), 0.0, "astar")
    if plan is None:
        return {"end": "not put together", "steps": len(states) - 1}
    failure = execute(graph, plan).failure
    return {"end": "carried out" if failure is None else failure.kind, "steps": len(states) - 1}


def executed_step(task: int) -> dict[str, Any]:
    """Return how a random step from a random state ends in the simulation, and 1 (0 if none)."""
    graph, rng = whole_graph(), np.random.default_rng([3, task])
    robot = StepExecutor(graph, Setup())
    robot.start(random_walk(graph, rng, int(rng.integers(6)))[-1])
    steps_from = graph.successors(robot.state)
    if not steps_from:
        return {"end": "no step on the branches chosen", "steps": 0}
    k = int(rng.integers(len(steps_from.limb)))
    after = steps_from.after(robot.state, k)
    robot.step(int(steps_from.limb[k]), int(steps_from.point[k]), after.branch_sets)
    failure = robot.measures["failure"]
    return {"end": "carried out" if failure is None else str(failure["kind"]), "steps": 1}


def study_walks(number: int, workers: int) -> dict[str, Any]:
    """Count the random walks of valid steps that have all their steps and a motion."""
    rows = study_rows("truth_walks:walk", number, workers)
    return {
        "walks": number,
        "steps": STEPS,
        "went_on": sum(row["whole"] for row in rows),
        "put_together": sum(row["motion"] for row in rows),
        "swings": dict(Counter(swing for row in rows for swing in row["swings"])),
    }


def study_execution(walks: int, steps: int, workers: int) -> dict[str, Any]:
    """Simulate random walks, and random steps from random states."""
    out: dict[str, Any] = {"pace": "at the default limits"}
    for name, number in (("walk", walks), ("step", steps)):
        rows = study_rows(f"truth_walks:executed_{name}", number, workers)
        ends, taken = Counter(row["end"] for row in rows), sum(row["steps"] for row in rows)
        out[f"{name}s"] = {"number": number, "steps": taken, "ends": dict(ends)}
    return out


class StateGraph:
    """All states reachable from some states, with their steps, for SciPy's Dijkstra.

    It is computed by `successors` alone.
    """

    def __init__(self, graph: StanceGraph, starts: Iterable[State]) -> None:
        """Compute the successors of every state once."""
        self.states = list(starts)
        self.index = {state: k for k, state in enumerate(self.states)}
        rows, cols, moved, places = list[int](), list[int](), [np.zeros(0)], []
        for state in tqdm(self.states, desc="states", mininterval=5.0):  # which grow
            places.append(graph.posture_of(state).base_position[0])
            steps_from = graph.successors(state)
            moved.append(np.linalg.norm(steps_from.base_position - places[-1], axis=1))
            for k in range(len(steps_from.limb)):
                after = steps_from.after(state, k)
                if after not in self.index:
                    self.index[after] = len(self.states)
                    self.states.append(after)
                rows.append(self.index[state])
                cols.append(self.index[after])
        self.places, self.moved = np.array(places), np.concatenate(moved)
        self.rows, self.cols = np.array(rows, dtype=int), np.array(cols, dtype=int)

    def costs(self, start: State, cost: Cost) -> Array:
        """Return the minimum cost from a state to every other one."""
        n = len(self.index)
        # SciPy interprets a zero as a missing edge.
        weights = np.maximum(cost.base_weight * self.moved + cost.step_weight, 1e-300)
        steps = csr_array((weights, (self.rows, self.cols)), shape=(n, n))
        return np.asarray(dijkstra(steps, indices=self.index[start]))


def study_optimality(queries: int, starts: int) -> dict[str, Any]:
    """Compare plans on half the points of the JEM with SciPy's Dijkstra over `successors`."""
    whole = jem_map()
    sparse = whole.subset(np.arange(len(whole)) % 2 == 0, "every second point")
    graph = two_limb_graph(sparse)
    step_tables(graph)
    states = StateGraph(graph, [graph.state(points.tolist()) for points in graph.points])
    planner, rng = Planner(graph), np.random.default_rng(4)
    out, worst, reached = Counter[str](), 0.0, 0
    for n in tqdm(range(starts), desc="queries", mininterval=5.0):
        name, price = COSTS[n % len(COSTS)]
        # After a step, the label of a support limb holds only some of its branches.
        start = random_walk(graph, rng, int(rng.integers(3)))[-1]
        costs = states.costs(start, Cost.named(name, price))
        for _ in range(queries // starts):
            # Most positions in the cabin are far from any stance.
            goal = graph.base_position[rng.integers(len(graph))] + rng.normal(size=3) * 0.05
            goal = np.clip(goal, *sparse.cabin)
            radius = float(rng.choice([0.05, 0.2]))
            inside = np.linalg.norm(states.places - goal, axis=1) <= radius
            least = float(costs[inside].min(initial=np.inf))
            how: dict[str, Any] = {} if price is None else {"regrasp_price": price}
            found = planner.plan(start, goal, name, goal_tolerance=radius, **how)
            out[f"{name} {'found' if found.plan else found.reason}"] += 1
            if (found.plan is None) != np.isinf(least):
                out["existence differs"] += 1
            elif found.plan is not None:
                reached += 1
                worst = max(worst, abs(found.plan.statistics.cost - least))
    return {
        "points": len(sparse),
        "states": len(states.index),
        "edges": len(states.rows),
        "queries": queries,
        "found": reached,
        "outcomes": dict(out),
        "largest_difference": worst,
    }


def small_map(rng: np.random.Generator) -> GraspMap:
    """Return a map of six points of the JEM that lie close to each other."""
    whole = jem_map()
    middle = whole.positions[rng.integers(len(whole))]
    close = np.argsort(np.linalg.norm(whole.positions - middle, axis=1))[:24]
    chosen = np.zeros(len(whole), dtype=np.bool_)
    chosen[rng.choice(close, 6, replace=False)] = True
    return whole.subset(chosen, "few points")


def small_query(task: int) -> dict[str, Any]:
    """Compare a query of three or four limbs on a small map with Dijkstra: outcome and error.

    Half of the tasks check collisions; half have a goal that need not be reachable.
    """
    rng, limbs = np.random.default_rng([5, task]), 3 + task % 2
    collisions, anywhere = task // 2 % 2 == 0, task // 4 % 2 == 0
    name, price = COSTS[task % len(COSTS)]
    settings = Settings(collisions=collisions)
    graph = stance_graph(small_map(rng), f"mlivr{limbs}", settings)
    starts = [tuple(rng.permutation(6)[:limbs].tolist()) for _ in range(200)]
    states = [graph.state(s) for s in starts if graph.is_node(graph.posture(s))[0]]
    if not states:
        return {"outcome": "no stance", "off": 0.0}
    # States that some step leaves are preferred, since the others test little.
    start = next((state for state in states[:40] if graph.successors(state)), states[0])
    cost = Cost.named(name, price)
    known = StateGraph(graph, [start])
    costs = known.costs(start, cost)
    choice = [graph.posture_of(s).base_position[0] for s in states] if anywhere else known.places
    goal = choice[int(rng.integers(len(choice)))]
    reached = costs[np.linalg.norm(known.places - goal, axis=1) <= 0.05]
    how: dict[str, Any] = {} if price is None else {"regrasp_price": price}
    found = Planner(graph).plan(
        start, goal, name, goal_tolerance=0.05, options=SearchOptions(inflation=1.0), **how
    )
    world = "collisions" if collisions else "no collisions"
    if (found.plan is None) != (not len(reached)):
        return {"outcome": f"{world}: existence differs", "off": np.inf}
    if found.plan is None:
        return {"outcome": f"{world}: neither finds a plan", "off": 0.0}
    outcome = "no step leads away" if len(known.states) == 1 else "both find one"
    off = abs(found.plan.statistics.cost - reached.min())
    return {"outcome": f"{world}: {outcome}", "off": off}


def study_small_maps(number: int, workers: int) -> dict[str, Any]:
    """Compare plans of three and four limbs on small maps with Dijkstra in plain Python."""
    rows = study_rows("truth_walks:small_query", number, workers)
    outcomes, worst = Counter(row["outcome"] for row in rows), max(row["off"] for row in rows)
    return {"maps": number, "outcomes": dict(outcomes), "largest_difference": worst}
