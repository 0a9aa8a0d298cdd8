"""Baselines of the literature that find walks over the same steps as the planner.

* `random`: a step drawn uniformly at random.
* `local`: local foothold choice, as in Bretl (2006) and Uno (2019): the step whose base is closest
  to the goal, never to a stance visited before.
* `mcts`: Monte Carlo tree search (Kocsis and Szepesvari 2006), used by Xu (2022) for free climbing:
  UCT with progressive widening over the steps in the order of their base's distance to the goal,
  with local foothold choice as rollout.
* `two_level`: the base path first and footholds second, as in Rodriguez (2024): the base shall
  follow the straight line to the goal; a greedy best-first search places footholds inside a
  corridor around it, which is widened if that fails.

A* without manipulability (Takada 2023) is `Planner` on a graph with
`Settings(manipulability=False)`.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable

import numpy as np

from mlivr_gym.arguments import NOT_NEGATIVE, SEED, Validators, checked
from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.batches import distance, distances
from mlivr_gym.planners.walks import Walk
from mlivr_gym.schema import Choice, Integer
from mlivr_gym.stances.moves import Moves
from mlivr_gym.transitions.state import State, Successors
from mlivr_gym.world.given_points import GOAL

CORRIDORS = (0.3, 0.6, 1.2)
"""Half widths of the corridors of `two_level`, in order [m]."""


class _Task:
    """A start, a goal and the moves between them, which counts the states expanded."""

    def __init__(
        self, moves: Moves, start: State, goal: Array, tolerance: float, max_steps: int
    ) -> None:
        self.moves, self.start = moves, start
        self.goal, self.tolerance, self.max_steps = goal, tolerance, max_steps
        self.expanded = 0

    def steps(self, state: State) -> Successors:
        """Return the steps that leave a state, and count an expansion."""
        self.expanded += 1
        return self.moves.successors(state)

    def distance(self, state: State) -> float:
        """Return the distance of the base from the goal [m]."""
        return distance(self.moves.stance_properties(state).base_position, self.goal.tolist())

    def is_at_goal(self, state: State) -> bool:
        """Return whether the base is within the goal region."""
        return self.distance(state) <= self.tolerance

    def walk(self, states: list[State]) -> Walk:
        """Return a sequence of states as the walk of a baseline."""
        return Walk(tuple(states), self.is_at_goal(states[-1]), self.expanded)


def random_walk(task: _Task, rng: np.random.Generator, budget: int) -> Walk:
    """Take random steps until the goal or the maximum number of steps."""
    states = [task.start]
    while not task.is_at_goal(states[-1]) and len(states) <= task.max_steps:
        steps = task.steps(states[-1])
        if not len(steps.limb):
            break
        states.append(steps.after(states[-1], int(rng.integers(len(steps.limb)))))
    return task.walk(states)


def local_walk(task: _Task, rng: np.random.Generator, budget: int) -> Walk:
    """Choose footholds locally: the step whose base is closest to the goal."""
    states, seen = [task.start], {task.start.stance}
    while not task.is_at_goal(states[-1]) and len(states) <= task.max_steps:
        steps = task.steps(states[-1])
        for k in np.argsort(distances(steps.base_position, task.goal), kind="stable"):
            after = steps.after(states[-1], int(k))
            if after.stance not in seen:
                states.append(after)
                seen.add(after.stance)
                break
        else:
            break
    return task.walk(states)


class _TreeNode:
    """A state of the search tree, its steps in the order of the base's distance to the goal."""

    __slots__ = ("children", "order", "state", "steps", "total", "visits")

    def __init__(self, task: _Task, state: State) -> None:
        self.state = state
        self.steps = task.steps(state)
        self.order = np.argsort(
            distances(self.steps.base_position, task.goal), kind="stable"
        ).tolist()
        self.children: list[_TreeNode] = []
        self.visits, self.total = 0, 0.0


def tree_search(task: _Task, rng: np.random.Generator, budget: int) -> Walk:
    """Find a walk by Monte Carlo tree search with `budget` simulations for each step."""
    states, scale = [task.start], 0.5
    while not task.is_at_goal(states[-1]) and len(states) <= task.max_steps:
        root = _TreeNode(task, states[-1])
        best: tuple[float, list[State]] = (-math.inf, [])
        for _ in range(budget):
            value, states_ahead = _simulate(task, root, rng, scale)
            best = max(best, (value, states_ahead), key=lambda pair: pair[0])
        if best[1] and task.is_at_goal(best[1][-1]):
            # A simulation that reaches the goal is a walk; later ones would only repeat it.
            return task.walk([*states, *best[1]])
        if not root.children:
            break
        chosen = max(root.children, key=lambda c: (c.visits, c.total))
        states.append(chosen.state)
    return task.walk(states)


def _simulate(
    task: _Task, root: _TreeNode, rng: np.random.Generator, scale: float
) -> tuple[float, list[State]]:
    """Run one simulation; return its value and the states passed.

    It descends the tree by UCT, adds a node, rolls out, and backs the value up.
    """
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
        if node.visits == 0 or len(ahead) >= task.max_steps:
            break
    state, seen = node.state, {n.state.stance for n in path}
    for _ in range(8):
        if task.is_at_goal(state):
            break
        steps = node.steps if state == node.state else task.steps(state)
        if not len(steps.limb):
            break
        far = distances(steps.base_position, task.goal)
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
    """Find footholds along the straight base path to the goal, inside a corridor around it."""
    origin = np.array(task.moves.stance_properties(task.start).base_position)
    length = float(np.linalg.norm(task.goal - origin))
    direction = (task.goal - origin) / max(length, 1e-9)
    for half_width in CORRIDORS:
        parents: list[int] = [-1]
        states, depth, seen = [task.start], [0], {task.start.stance}
        queue: list[tuple[float, int]] = [(0.0, 0)]
        while queue and len(states) < 20_000:
            _, index = heapq.heappop(queue)
            if task.is_at_goal(states[index]):
                chain = [index]
                while parents[chain[-1]] >= 0:
                    chain.append(parents[chain[-1]])
                return task.walk([states[k] for k in reversed(chain)])
            if depth[index] >= task.max_steps:
                continue
            steps = task.steps(states[index])
            far = distances(steps.base_position, task.goal)
            along = (steps.base_position - origin) @ direction
            aside = np.linalg.norm(
                steps.base_position - origin - np.clip(along, 0.0, length)[:, None] * direction,
                axis=1,
            )
            for k in np.flatnonzero(aside <= half_width):
                after = steps.after(states[index], int(k))
                if after.stance not in seen:
                    seen.add(after.stance)
                    states.append(after)
                    parents.append(index)
                    depth.append(depth[index] + 1)
                    heapq.heappush(queue, (float(far[k]), len(states) - 1))
    return task.walk([task.start])


BASELINES: dict[str, Callable[[_Task, np.random.Generator, int], Walk]] = {
    "random": random_walk, "local": local_walk, "mcts": tree_search, "two_level": two_level,
}  # fmt: skip
"""The baselines by name."""


BASELINE: Validators = {
    "method": Choice(tuple(BASELINES)),
    "goal": GOAL,
    "tolerance": NOT_NEGATIVE,
    "max_steps": Integer(0, 10**6),
    "budget": Integer(1, 10**6),
    "seed": SEED,
}
"""Validators of the arguments of `find_walk`."""


@checked(BASELINE)
def find_walk(
    method: str,
    moves: Moves,
    start: State,
    goal: Array,
    tolerance: float = 0.2,
    *,
    max_steps: int = 100,
    budget: int = 50,
    seed: int = 0,
) -> Walk:
    """Find a walk by one of the baselines.

    The method is one of `BASELINES`, and the moves are those of the world, `MlivrEnv.moves`. The
    goal position has shape (3,) [m], its region the radius `tolerance` [m]. `mcts` makes `budget`
    simulations for each step; it and `random` are seeded. Raises a `SettingError` if the method is
    unknown, and a `StanceError` if the start is no state of the map.
    """
    moves.graph.check(start)
    task = _Task(moves, start, np.asarray(goal, dtype=np.float64), tolerance, max_steps)
    return BASELINES[method](task, np.random.default_rng(seed), budget)
