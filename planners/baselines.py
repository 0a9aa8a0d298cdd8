"""Other methods to find a walk, after the literature; all work on the edges of the graph.

* `random`: any step, each as likely as the others.
* `local`: local foothold choice, as in Bretl (2006) and Uno (2019): the step whose base comes
  nearest to the goal, never back to a stance already visited.
* `mcts`: Monte Carlo tree search (Kocsis and Szepesvari, 2006), as Xu (2022) uses it for free
  climbing: UCT with progressive widening over the steps in the order of their base's distance to
  the goal, and local choice as rollout.
* `two_level`: the base path first, footholds after, as in Rodriguez (2024): the base shall follow
  the straight line to the goal; footholds are searched best first, farthest along first, inside a
  corridor round it, which widens where there are none.

A* without manipulability (Takada, 2023) is `Planner` on a graph with
`Settings(manipulability=False)`; `walks.edges_along` then tells how far its plans are edges
under the thresholds.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import choice
from mlivr_gym.kinematics.batches import distance, distances
from mlivr_gym.planners.walks import Walk
from mlivr_gym.stances.moves import Moves
from mlivr_gym.transitions.state import State, Successors

CORRIDORS = (0.3, 0.6, 1.2)
"""Half widths of the corridor that `two_level` tries one after the other [m]."""


class _Task:
    """A start, a goal and the moves between, with a count of the states expanded."""

    def __init__(
        self, moves: Moves, start: State, goal: Array, tolerance: float, longest: int
    ) -> None:
        self.moves, self.start = moves, start
        self.goal, self.tolerance, self.longest = goal, tolerance, longest
        self.expanded = 0

    def steps(self, state: State) -> Successors:
        self.expanded += 1
        return self.moves.successors(state)

    def distance(self, state: State) -> float:
        return distance(self.moves.place(state).base_in_world, self.goal.tolist())

    def is_at_goal(self, state: State) -> bool:
        return self.distance(state) <= self.tolerance

    def walk(self, states: list[State]) -> Walk:
        return Walk(tuple(states), self.is_at_goal(states[-1]), self.expanded)


def random_walk(task: _Task, rng: np.random.Generator, budget: int) -> Walk:
    """Random possible actions until the goal or `longest` steps."""
    states = [task.start]
    while not task.is_at_goal(states[-1]) and len(states) <= task.longest:
        steps = task.steps(states[-1])
        if not len(steps.limb):
            break
        states.append(steps.after(states[-1], int(rng.integers(len(steps.limb)))))
    return task.walk(states)


def local_walk(task: _Task, rng: np.random.Generator, budget: int) -> Walk:
    """Local foothold choice."""
    states, seen = [task.start], {task.start.stance}
    while not task.is_at_goal(states[-1]) and len(states) <= task.longest:
        steps = task.steps(states[-1])
        for k in np.argsort(distances(steps.base_in_world, task.goal), kind="stable"):
            after = steps.after(states[-1], int(k))
            if after.stance not in seen:
                states.append(after)
                seen.add(after.stance)
                break
        else:
            break
    return task.walk(states)


class _TreeNode:
    """A state of the search tree: its steps in order of promise, and what was tried."""

    __slots__ = ("children", "order", "state", "steps", "total", "visits")

    def __init__(self, task: _Task, state: State) -> None:
        self.state = state
        self.steps = task.steps(state)
        self.order = np.argsort(
            distances(self.steps.base_in_world, task.goal), kind="stable"
        ).tolist()
        self.children: list[_TreeNode] = []
        self.visits, self.total = 0, 0.0


def tree_search(task: _Task, rng: np.random.Generator, budget: int) -> Walk:
    """Monte Carlo tree search, `budget` simulations for each step taken."""
    states, scale = [task.start], 0.5
    while not task.is_at_goal(states[-1]) and len(states) <= task.longest:
        root = _TreeNode(task, states[-1])
        best: tuple[float, list[State]] = (-math.inf, [])
        for _ in range(budget):
            value, states_ahead = _simulate(task, root, rng, scale)
            best = max(best, (value, states_ahead), key=lambda pair: pair[0])
        if best[1] and task.is_at_goal(best[1][-1]):
            # A simulation that arrives is a plan: later ones would only repeat it.
            return task.walk([*states, *best[1]])
        if not root.children:
            break
        chosen = max(root.children, key=lambda c: (c.visits, c.total))
        states.append(chosen.state)
    return task.walk(states)


def _simulate(
    task: _Task, root: _TreeNode, rng: np.random.Generator, scale: float
) -> tuple[float, list[State]]:
    """Descend, add a node, roll out, and back the value up; the value and the states passed."""
    node, path, ahead = root, [root], list[State]()
    while node.order and not task.is_at_goal(node.state):
        allowed = min(len(node.order), 2 + int(math.sqrt(node.visits)))
        if len(node.children) < allowed:
            child = _TreeNode(task, node.steps.after(node.state, node.order[len(node.children)]))
            node.children.append(child)
        else:
            log = math.log(node.visits + 1)
            child = max(
                node.children,
                key=lambda c: c.total / c.visits + math.sqrt(2.0 * log / c.visits),
            )
        path.append(child)
        ahead.append(child.state)
        node = child
        if node.visits == 0 or len(ahead) >= task.longest:
            break
    state, seen = node.state, {n.state.stance for n in path}
    for _ in range(8):
        if task.is_at_goal(state):
            break
        steps = node.steps if state == node.state else task.steps(state)
        if not len(steps.limb):
            break
        far = distances(steps.base_in_world, task.goal)
        k = int(np.argmin(far + 0.1 * rng.random(len(far))))
        state = steps.after(state, k)
        if state.stance in seen:
            break
        seen.add(state.stance)
        ahead.append(state)
    value = -float(len(ahead)) - 2.0 * max(0.0, task.distance(state) - task.tolerance) / scale
    for passed in path:
        passed.visits += 1
        passed.total += value / 10.0
    return value, ahead


def two_level(task: _Task, rng: np.random.Generator, budget: int) -> Walk:
    """The base path first, footholds after."""
    origin = np.array(task.moves.place(task.start).base_in_world)
    length = float(np.linalg.norm(task.goal - origin))
    direction = (task.goal - origin) / max(length, 1e-9)
    for half_width in CORRIDORS:
        parents: list[int] = [-1]
        states, depth, seen = [task.start], [0], {task.start.stance}
        queue: list[tuple[float, int]] = [(0.0, 0)]
        while queue and len(states) < 20_000:
            _, here = heapq.heappop(queue)
            if task.is_at_goal(states[here]):
                chain = [here]
                while parents[chain[-1]] >= 0:
                    chain.append(parents[chain[-1]])
                return task.walk([states[k] for k in reversed(chain)])
            if depth[here] >= task.longest:
                continue
            steps = task.steps(states[here])
            far = distances(steps.base_in_world, task.goal)
            along = (steps.base_in_world - origin) @ direction
            aside = np.linalg.norm(
                steps.base_in_world - origin - np.clip(along, 0.0, length)[:, None] * direction,
                axis=1,
            )
            for k in np.flatnonzero(aside <= half_width):
                after = steps.after(states[here], int(k))
                if after.stance not in seen:
                    seen.add(after.stance)
                    states.append(after)
                    parents.append(here)
                    depth.append(depth[here] + 1)
                    heapq.heappush(queue, (float(far[k]), len(states) - 1))
    return task.walk([task.start])


BASELINES: dict[str, Callable[[_Task, np.random.Generator, int], Walk]] = {
    "random": random_walk, "local": local_walk, "mcts": tree_search, "two_level": two_level,
}  # fmt: skip
"""The baselines by name."""


def find_walk(
    method: str,
    moves: Moves,
    start: State,
    goal: Array,
    tolerance: float = 0.2,
    *,
    longest: int = 100,
    budget: int = 50,
    seed: int = 0,
) -> Walk:
    """A walk by one of the baselines.

    Parameters
    ----------
    method
        One of `FINDERS`.
    moves
        The moves of the world, `MlivrEnv.moves`.
    start
        Where to start.
    goal
        Goal position of the base [m], shape (3,).
    tolerance
        Radius of the goal region [m].
    longest
        Most steps.
    budget
        Simulations for each step of `mcts`.
    seed
        Seed of `random` and `mcts`.

    Raises
    ------
    SettingError
        If the method is unknown.
    """
    choice("method", method, BASELINES)
    task = _Task(moves, start, np.asarray(goal, dtype=np.float64), tolerance, longest)
    return BASELINES[method](task, np.random.default_rng(seed), budget)
