"""The course of a closed loop: the plan that the robot follows, and when another takes its place.

A plan of a search that was cut short may be longer than what remains of the one before, and so may
the next one; a robot that follows each could go back and forth. It therefore keeps the remainder of
its plan as long as that is cheaper than the new plan and still possible.

While a limb swings, the robot plans on from the state in which it will arrive, so that little is
left to do when it has arrived. If it then sees something new, but knows a step that is still
possible, a plan is sought with little effort (`AT_ONCE`), and again with more during that step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mlivr_gym.closed_loop.belief import Belief
from mlivr_gym.planners import Plan, PlanningResult
from mlivr_gym.planners.outcome import LIMIT_REACHED
from mlivr_gym.planners.planning_result import PROVED_IMPOSSIBLE
from mlivr_gym.transitions.state import State

PATIENCE = 4.0
"""Effort with which any plan is searched for if there is none at the limit, relative to it."""

AT_ONCE = 0.025
"""Relative effort for a robot that knows a next step, and should not stand still to plan."""

ROUNDING = 1e-9
"""Difference of two costs that is due to rounding."""


class _Forecast(NamedTuple):
    """What was planned for a state before the robot was in it."""

    state: State
    """The state."""
    version: int
    """Version of the graph in which it was planned."""
    result: PlanningResult
    """What was found."""


class Course:
    """The plan that a robot follows, and how many of its steps were taken.

    Attributes
    ----------
    plan
        The plan; None if there is none.
    taken
        Number of its steps that were taken.
    is_new
        Whether it was found in the last planning. The swings of an older one were checked among
        the obstacles of then.
    """

    def __init__(self, belief: Belief, plan_from: Callable[[State, float], PlanningResult]) -> None:
        """Plan in what is believed, by a function of the state and a factor of the effort."""
        self._belief, self._graph, self._plan_from = belief, belief.graph, plan_from
        self.plan: Plan | None = None
        self.taken, self.is_new = 0, False
        self._forecast: _Forecast | None = None

    def plan_ahead(self, state: State) -> bool:
        """Plan from a state in which the robot will be; return whether anything was to be done."""
        self._belief.update_graph(state)
        if self._foreseen(state) is not None:
            return False
        self._forecast = _Forecast(state, self._graph.version, self._plan_from(state, 1.0))
        return True

    def _foreseen(self, state: State) -> _Forecast | None:
        """Return what was planned ahead for a state, None if it does not hold in what is believed.

        That there is no plan is taken to hold while nothing goes, though it is proved of then
        alone.
        """
        found, graph = self._forecast, self._graph
        if found is None or found.state != state:
            return None
        is_none = found.result.reason in PROVED_IMPOSSIBLE
        holds = found.version == graph.version or (is_none and graph.has_all_since(found.version))
        return found if holds else None

    def _search(self, state: State, patience: float = 1.0) -> PlanningResult:
        """Plan from a state in what is believed now."""
        self._belief.update_graph(state)
        return self._plan_from(state, patience)

    def _search_at_once(self, state: State) -> PlanningResult:
        """Plan from a state, with little effort if the robot knows a next step.

        If no plan is found then, what was planned ahead in an earlier world is returned if it is
        still possible.
        """
        ahead, known = self._forecast, None
        if ahead is not None and ahead.state == state and ahead.result.plan is not None:
            known = ahead.result if self._leads_on(ahead.result.plan, 0, state) else None
        if known is None and not self._remains(state):
            return self._plan_from(state, 1.0)
        found = self._plan_from(state, AT_ONCE)
        return known if known is not None and found.reason == LIMIT_REACHED else found

    def replan(self, state: State, is_retry: bool = False) -> PlanningResult:
        """Plan from a state in what is believed now; follow the plan, or what remains of the last.

        Of two that cost the same, the new one is followed, except in a retry of a step. If neither
        exists, a plan is sought without obstacles that were told and not seen, among smaller and
        fewer boxes, and with points to which paths were blocked, see `Belief.relax`, and then,
        unless it is proved that there is none, with `PATIENCE` times the effort.
        """
        belief = self._belief
        belief.update_graph(state)
        foreseen = self._foreseen(state)
        is_present = foreseen is None or foreseen.version == self._graph.version
        result = foreseen.result if foreseen else self._search_at_once(state)
        while result.plan is None and not self._remains(state):
            if not belief.relax() and is_present:
                break
            result, is_present = self._search(state), True
        is_proved = result.reason in PROVED_IMPOSSIBLE
        if result.plan is None and not is_proved and not self._remains(state):
            result = self._search(state, PATIENCE)
        new = result.plan
        is_followed = new is not None and (
            self._is_preferred(new, is_retry) or not self._remains(state)
        )
        self.is_new = is_followed and not self._is_of_earlier_world(result)
        if is_followed:
            self.plan, self.taken = new, 0
        elif new is None and not self._remains(state):
            self.plan = None
        return result

    def _is_of_earlier_world(self, result: PlanningResult) -> bool:
        """Return whether a result was found ahead, and the world has changed since."""
        ahead = self._forecast
        return ahead is not None and ahead.result is result and ahead.version != self._graph.version

    def _is_preferred(self, new: Plan, is_retry: bool) -> bool:
        """Return whether a plan costs less than what remains of the one followed, or as much."""
        if self.plan is None:
            return True
        rest = self.plan.query.cost_of(self.plan.motion.base_positions[self.taken :])
        return new.cost < rest + (-ROUNDING if is_retry else ROUNDING)

    def _remains(self, state: State) -> bool:
        """Return whether the remainder of the plan leads on from a state in what is believed."""
        return self.plan is not None and self._leads_on(self.plan, self.taken, state)

    def _leads_on(self, plan: Plan, taken: int, state: State) -> bool:
        """Return whether what remains of a plan leads on from a state in what is believed."""
        graph = self._graph
        if plan.stances[taken] != graph.ids(state.stance):
            return False
        for stance in plan.stances[taken + 1 :]:
            after = graph.step_to(state, graph.indices(stance))
            if after is None:
                return False
            state = after
        return True
