"""The course of a closed loop: the plan that the robot follows, and when another takes its place.

A plan of a search with a time limit may be longer than what remains of the one before, and so may
the next one; a robot that follows each could go back and forth. It therefore keeps the remainder of
its plan as long as that is cheaper than the new plan and still possible.
"""

from __future__ import annotations

from collections.abc import Callable

from mlivr_gym.closed_loop.belief import Belief
from mlivr_gym.planners import Plan, PlanningResult
from mlivr_gym.planners.planning_result import PROVED_IMPOSSIBLE
from mlivr_gym.transitions.state import State

ROUNDING = 1e-9
"""Difference of two costs that is due to rounding."""


class Course:
    """The plan that a robot follows, and how many of its steps were taken.

    Attributes
    ----------
    plan
        The plan; None before the first one.
    taken
        Number of its steps that were taken.
    """

    def __init__(self, belief: Belief, plan_from: Callable[[State], PlanningResult]) -> None:
        """Plan in what is believed, by a function."""
        self._belief, self._graph, self._plan_from = belief, belief.graph, plan_from
        self.plan: Plan | None = None
        self.taken = 0

    def replan(self, state: State) -> PlanningResult:
        """Plan from a state in what is believed now; follow the plan, or what remains of the last.

        If no plan exists, it is sought once more among smaller boxes, see `Belief.tighten`.
        """
        self._belief.update_graph()
        result = self._plan_from(state)
        if result.reason in PROVED_IMPOSSIBLE and self._belief.tighten():
            result = self._plan_from(state)
        if result.plan is not None and not self._keeps(result.plan, state):
            self.plan, self.taken = result.plan, 0
        return result

    def _keeps(self, new: Plan, state: State) -> bool:
        """Return whether the remainder of the plan is cheaper than a new one, and possible."""
        plan, taken, graph = self.plan, self.taken, self._graph
        if plan is None or plan.stances[taken] != graph.ids(state.stance):
            return False
        rest = plan.query.cost_of(plan.motion.base_positions[taken:])
        if rest > new.cost - ROUNDING:
            return False
        for limb, point in plan.actions[taken:]:
            successors = graph.successors(state)
            row = successors.find(limb, graph.grasp_map.index(point))
            if row < 0:
                return False
            state = successors.after(state, row)
        return True
