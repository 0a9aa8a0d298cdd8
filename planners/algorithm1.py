"""Algorithm 1 of the paper in plain Python: A* over stances (Hart, Nilsson and Raphael 1968).

This is the search to read first, and the reference for the compiled searches (`table_search`,
`implicit_search`). It uses `posture_of`, `successors` and `max_displacement` of a stance graph
alone, so it serves any number of limbs. With `Settings(transitions=False, collisions=False)` and
`heuristic="paper"` its nodes, edges and estimates are those of the paper. If steps are checked, a
node of the search is a `State`: a stance together with the branches that each limb may be on.

The line numbers are those of this listing, not of that in the paper:

    1   open <- {start}, g(start) <- 0, closed <- {}
    2   while open is not empty:
    3       s <- the entry of open with the least f; of equal ones the largest g, then the oldest
    4       if s is in closed: continue with the next entry; closed <- closed + {s}
    5       if the base at s lies within the tolerance of the goal: return the path to s
    6       for each limb and each point that it can step to, which leads to s':
    7           g' <- g(s) + cost(s, s')
    8           if s' is not in closed and g' < g(s'): g(s') <- g', parent(s') <- s
    9               open <- open + {s'} with f(s') = g' + h(s')
    10  return failure
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array
from mlivr_gym.planners.costs import HEURISTICS
from mlivr_gym.planners.outcome import GOAL_REACHED, LIMIT_REACHED, SEARCH_EXHAUSTED
from mlivr_gym.planners.query import EXPANSIONS, QUERY, Goal
from mlivr_gym.schema import Choice, Tuples
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State


@dataclass
class SearchTree:
    """The expanded states of a search in order, the goal last if it was reached."""

    status: str = SEARCH_EXHAUSTED
    """`GOAL_REACHED`, `SEARCH_EXHAUSTED` or `LIMIT_REACHED`."""
    states: list[State] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    """Index of the parent of each state, -1 at the start."""
    costs: list[float] = field(default_factory=list)
    """Cost from the start."""
    positions: list[Array] = field(default_factory=list)
    """Base position of each state [m], shape (3,)."""
    generated: int = 1
    """Number of states put into the open queue, the start included."""


@checked(
    {
        **{name: kind for name, kind in QUERY.items() if name not in ("start", "goal")},
        "heuristic": Choice(HEURISTICS[1:]),
        "inflation": Tuples((), 0.0),
    }
)
def algorithm1(
    graph: StanceGraph,
    start: State,
    goal: Goal,
    heuristic: str = "consistent",
    *,
    inflation: float = 1.0,
    limit: int = EXPANSIONS,
    progress: Callable[[int], None] | None = None,
) -> SearchTree:
    """Search from a state to any stance at the goal.

    The heuristic is `"consistent"`, `"paper"` or `"zero"`, see `Cost.heuristic`, times `inflation`;
    with 1 and a consistent heuristic the path has minimum cost. At most `limit` states are
    expanded; `progress` is called with their number. The parents of the expanded states, which are
    returned, give the path.
    """
    cost = goal.cost

    def estimate(positions: Array) -> Array:
        distance = goal.distance(positions)
        return inflation * cost.heuristic(
            heuristic, distance, goal.tolerance, graph.max_displacement
        )

    tree = SearchTree()
    origin = graph.posture_of(start).base_position[0]
    # An entry: f, minus g, its age, the state, its base position, and the index of its parent.
    queue = [(float(estimate(origin)), 0.0, 0, start, origin, -1)]  # line 1
    best_cost, closed = {start: 0.0}, set()
    while queue:  # line 2
        _, minus_g, _, state, position, parent = heapq.heappop(queue)  # line 3
        if state in closed:  # line 4
            continue
        closed.add(state)
        index = len(tree.states)
        tree.states.append(state)
        tree.parents.append(parent)
        tree.costs.append(-minus_g)
        tree.positions.append(position)
        if goal.reached(position, state.stance):  # line 5
            tree.status = GOAL_REACHED
            return tree
        if index + 1 >= limit:
            tree.status = LIMIT_REACHED
            return tree
        if progress is not None and index % 100 == 0:
            progress(index)
        steps = graph.successors(state)  # line 6
        distances = np.linalg.norm(steps.base_position - position, axis=1)
        g = -minus_g + cost.of_steps(distances, steps.stances(state), steps.point)  # line 7
        f = g + estimate(steps.base_position)
        for k in range(len(steps.limb)):
            after = steps.after(state, k)
            if after not in closed and g[k] < best_cost.get(after, np.inf):  # line 8
                best_cost[after] = float(g[k])
                entry = (float(f[k]), -float(g[k]), tree.generated)
                heapq.heappush(queue, (*entry, after, steps.base_position[k], index))  # line 9
                tree.generated += 1
    return tree  # line 10
