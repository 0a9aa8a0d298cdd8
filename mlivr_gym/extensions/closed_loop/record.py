"""The record of a closed loop: what happened, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.planners import Plan
from mlivr_gym.simulation import Recording
from mlivr_gym.stances import State
from mlivr_gym.world import Box

ARRIVED, STOPPED, FAILED = "arrived", "stopped", "failed"
"""Outcomes of a walk. A robot that stopped holds all its points; one that failed may not."""


LINES = {
    "sensed": "sees something new, {boxes} boxes now",
    "planned": "plans {steps} steps",
    "step": "limb {limb} takes {point} in {duration:.1f} s",
    "refused": "limb {limb} cannot grasp {point} ({failure}) and goes back",
    "blocked": "limb {limb} has no way to {point} ({failure})",
    "end": "{outcome}",
}
"""The line that tells each kind of event, with its values."""


@dataclass(frozen=True)
class Event:
    """Something that happened in a closed loop."""

    kind: str
    """`"sensed"`, `"planned"`, `"step"`, `"refused"`, `"blocked"` or `"end"`."""
    time: float
    """Simulated time [s]."""
    values: dict[str, Any]
    """What belongs to it: `"sensed"` has `boxes`, the number of boxes of all that is seen so far;
    `"planned"` has `steps` and `computing_time` [s]; `"step"` has `limb`, `point` and `duration`
    [s]; `"refused"` and `"blocked"` have `limb`, `point` and `failure`, its kind; `"end"` has
    `outcome` and `reason`."""

    @property
    def line(self) -> str:
        """The event in a few words."""
        return LINES[self.kind].format(**self.values)


@dataclass
class Footage:
    """What a film of a closed loop shows beside the events."""

    recordings: list[Recording] = field(default_factory=list)
    """The motions of the robot, in order."""
    looks: list[tuple[float, tuple[Box, ...]]] = field(default_factory=list)
    """The time of each look of the cameras [s], and all boxes that are believed after it."""
    plans: list[tuple[float, Plan]] = field(default_factory=list)
    """The time from which each plan is followed [s], and the plan."""

    @property
    def recording(self) -> Recording:
        """The motions one after the other."""
        return Recording.join(self.recordings)


@dataclass
class ClosedLoopRecord:
    """The record of a closed loop."""

    outcome: str = FAILED
    """`ARRIVED`, `STOPPED` or `FAILED`."""
    reason: str = ""
    """Why the walk ended, in one sentence."""
    proved: bool = False
    """Whether a robot that stopped has proved that no plan exists in the world that it believes
    in."""
    events: list[Event] = field(default_factory=list)
    """What happened, in order."""
    plans: list[tuple[Plan, int]] = field(default_factory=list)
    """Each plan that led the robot elsewhere than the one before, with the number of its steps that
    were taken."""
    sensed: tuple[Box, ...] = ()
    """Boxes that were sensed."""
    state: State | None = None
    """The state of the stance graph after the last step; None if no step could be planned."""
    refused: tuple[str, ...] = ()
    """Ids of the points that count as occupied, since limbs did not get to them or were refused."""
    peak_force: float = 0.0
    """Largest force of a grasp [N]."""
    duration: float = 0.0
    """Simulated time [s]."""
    footage: Footage | None = None
    """What a film shows; None if none was asked for."""

    @property
    def steps(self) -> int:
        """Number of steps that ended with a grasp."""
        return sum(event.kind == "step" for event in self.events)

    @property
    def replanning_times(self) -> Array:
        """Computing time of each plan after the first [s]."""
        planned = [
            event.values["computing_time"] for event in self.events if event.kind == "planned"
        ]
        return np.array(planned[1:])

    def add_step(self, plan: Plan) -> None:
        """Record the first step of a plan, which may be the rest of the plan before it."""
        if self.plans:
            last, taken = self.plans[-1]
            if last.actions[taken:] == plan.actions:
                self.plans[-1] = last, taken + 1
                return
        self.plans.append((plan, 1))

    def to_dict(self) -> dict[str, Any]:
        """Return the record as plain data for JSON."""
        return {
            "outcome": self.outcome,
            "reason": self.reason,
            "proved": self.proved,
            "steps": self.steps,
            "duration": self.duration,
            "peak_force": self.peak_force,
            "sensed": [box.to_dict() for box in self.sensed],
            "refused": list(self.refused),
            "events": [
                {"kind": event.kind, "time": event.time} | event.values for event in self.events
            ],
        }
