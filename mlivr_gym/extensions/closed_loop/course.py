"""The course of a closed loop: the plan that the robot follows, and when another takes its place.

A robot goes on with what remains of its plan while that is possible, and searches where it is not.
"""

from __future__ import annotations

from collections.abc import Callable

from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.planners import PROVED_IMPOSSIBLE, Plan, Planner, PlanningResult
from mlivr_gym.stances import State

PATIENCE = 4.0
"""Effort with which any plan is searched for if there is none at the limit, relative to it."""


class Course:
    """The plan that a robot follows, and how many of its steps were taken.

    `plan` is as it is possible in what was believed when the robot last planned, None if there is
    none; `taken` is the number of its steps that were taken since.
    """

    def __init__(
        self,
        belief: Belief,
        planner: Planner,
        plan_from: Callable[[State, float], PlanningResult],
    ) -> None:
        """Plan in what is believed, by a function of the state and a factor of the effort."""
        self._belief, self._planner, self._plan_from = belief, planner, plan_from
        self.plan: Plan | None = None
        self.taken = 0

    def replan(self, state: State) -> PlanningResult:
        """Follow what remains of the plan, else plan from a state in what is believed now.

        If no plan is found, one is sought without obstacles that were told and not seen, among
        smaller and fewer boxes, and with points to which paths were blocked, see `Belief.relax`,
        and then, unless it is proved that there is none, with `PATIENCE` times the effort.
        """
        self._belief.update_graph(state)
        result = self._remainder(state) or self._plan_from(state, 1.0)
        while result.plan is None and self._belief.relax():
            self._belief.update_graph(state)
            result = self._plan_from(state, 1.0)
            if result.plan is None:
                result = self._remainder(state) or result
        if result.plan is None and result.reason not in PROVED_IMPOSSIBLE:
            result = self._plan_from(state, PATIENCE)
        self.plan, self.taken = result.plan, 0
        return result

    def _remainder(self, state: State) -> PlanningResult | None:
        """Return what remains of the plan that is followed, None if it does not lead on."""
        if self.plan is None:
            return None
        return self._planner.remainder(self.plan, self.taken, state)
