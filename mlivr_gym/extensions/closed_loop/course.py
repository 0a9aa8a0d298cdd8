"""The course of a closed loop: the plan that the robot follows, and when another takes its place.

While a limb swings, the robot plans on from the state in which it will arrive. When it has arrived
it stands still for a search only if it knows no plan that is still possible: neither the one that
was found on the way, nor what remains of the one that it follows. Of these it takes the cheaper
one: a plan of a search that was cut short may be longer than what remains of the one before, and so
may the next one, and a robot that follows each could go back and forth.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.planners import PROVED_IMPOSSIBLE, Plan, Planner, PlanningResult
from mlivr_gym.stances import State

PATIENCE = 4.0
"""Effort with which any plan is searched for if there is none at the limit, relative to it."""

ROUNDING = 1e-9
"""Difference of two costs that is due to rounding."""


class _Forecast(NamedTuple):
    """What was planned for a state before the robot was in it."""

    state: State
    """The state."""
    sought: int
    """Version of the graph in which a plan was sought."""
    checked: int
    """Version of the graph in which it was last found possible."""
    result: PlanningResult
    """What was found."""


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
        self._belief, self._graph, self._plan_from = belief, belief.graph, plan_from
        self._planner = planner
        self._forecast: _Forecast | None = None
        self.plan: Plan | None = None
        self.taken = 0

    def plan_ahead(self, state: State) -> bool:
        """Plan from a state in which the robot will be; return whether anything was to be done.

        A plan that is still possible is kept while nothing goes, since what comes makes no other
        plan cheaper.
        """
        self._belief.update_graph(state)
        before, version = self._forecast, self._graph.version
        is_known = self._foreseen(state) is not None
        if not (is_known and self._forecast and self._graph.has_all_since(self._forecast.sought)):
            self._forecast = _Forecast(state, version, version, self._plan_from(state, 1.0))
        return self._forecast is not before

    def _foreseen(self, state: State) -> PlanningResult | None:
        """Return what was planned ahead for a state, None if it does not hold in what is believed.

        That there is no plan is taken to hold while nothing goes, though it is proved of then
        alone.
        """
        found, graph = self._forecast, self._graph
        if found is None or found.state != state:
            return None
        if found.result.plan is None:
            is_none = found.result.reason in PROVED_IMPOSSIBLE
            holds = found.sought == graph.version or (is_none and graph.has_all_since(found.sought))
            return found.result if holds else None
        if found.checked != graph.version:
            rest = self._planner.remainder(found.result.plan, 0, state)
            found = found._replace(checked=graph.version, result=rest) if rest else None
            self._forecast = found
        return found and found.result

    def _search(self, state: State, patience: float = 1.0) -> PlanningResult:
        """Plan from a state in what is believed now."""
        self._belief.update_graph(state)
        return self._plan_from(state, patience)

    def replan(self, state: State, is_retry: bool = False) -> PlanningResult:
        """Follow a plan that is known and possible, else plan from a state in what is believed now.

        If no plan is found, one is sought without obstacles that were told and not seen, among
        smaller and fewer boxes, and with points to which paths were blocked, see `Belief.relax`,
        and then, unless it is proved that there is none, with `PATIENCE` times the effort.
        """
        self._belief.update_graph(state)
        result = self._known(state, is_retry) or self._found(state)
        self.plan, self.taken = result.plan, 0
        return result

    def _known(self, state: State, is_retry: bool) -> PlanningResult | None:
        """Return the cheapest plan that is known and leads on from a state, None if none does.

        It is what was planned ahead, or what remains of the plan that is followed. Of two that cost
        the same it is the first, except in a retry of a step.
        """
        ahead = self._foreseen(state)
        if ahead is not None and ahead.plan is not None:
            if self._is_preferred(ahead.plan, is_retry):
                return ahead
            return self._remainder(state) or ahead
        return self._remainder(state)

    def _found(self, state: State) -> PlanningResult:
        """Plan from a state from which no plan is known, and again while less is believed."""
        ahead, is_present = self._foreseen(state), True
        if ahead is not None and self._forecast is not None:
            is_present = self._forecast.sought == self._graph.version
        result = self._plan_from(state, 1.0) if ahead is None else ahead
        while result.plan is None:
            if not self._belief.relax() and is_present:
                break
            result, is_present = self._search(state), True
            if result.plan is None:
                result = self._remainder(state) or result
        if result.plan is None and result.reason not in PROVED_IMPOSSIBLE:
            result = self._search(state, PATIENCE)
        return result

    def _is_preferred(self, new: Plan, is_retry: bool) -> bool:
        """Return whether a plan costs less than what remains of the one followed, or as much."""
        if self.plan is None:
            return True
        rest = self.plan.query.cost_of(self.plan.motion.base_positions[self.taken :])
        return new.cost < rest + (-ROUNDING if is_retry else ROUNDING)

    def _remainder(self, state: State) -> PlanningResult | None:
        """Return what remains of the plan that is followed, None if it does not lead on."""
        if self.plan is None:
            return None
        return self._planner.remainder(self.plan, self.taken, state)
