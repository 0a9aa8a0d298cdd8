"""Film of a closed loop: what the robot has seen, what is there, its plan, and what happens."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.closed_loop.crew import CrewMember
from mlivr_gym.closed_loop.record import ClosedLoopRecord, Event, Footage
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.pictures.film import (
    DEFAULT_SIZE,
    SPEED,
    check_film_format,
    default_speed,
    film_pictures,
    film_samples,
    save_film,
)
from mlivr_gym.pictures.rendering import SIZE, Shot
from mlivr_gym.pictures.route import Route
from mlivr_gym.pictures.scene_shapes import add_box, add_capsule, rgba
from mlivr_gym.planners import Plan
from mlivr_gym.schema import ListOf, OrNone
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.world.boxes import Box

UNKNOWN_OPACITY = 0.25
"""Opacity of a box that the robot does not know, relative to one that it has seen."""

CREW_COLOUR, LABEL_COLOUR = "#4477aa", "#5a1a00"
"""Colours of crew members, and of the ids of unknown boxes."""


class Moment(NamedTuple):
    """What a film shows at a time."""

    time: float
    """Simulated time [s]."""
    sensed: tuple[Box, ...]
    """Boxes that the robot has sensed by then."""
    plan: Plan | None
    """The plan that it follows; None before the first one."""
    progress: str
    """Number of the step, and of all steps if those planned are taken."""
    news: str
    """What happened last."""

    @classmethod
    def of(cls, record: ClosedLoopRecord, time: float) -> Moment:
        """Return the moment of a walk at a time [s]."""
        footage = record.footage or Footage()
        happened = [event for event in record.events if event.time <= time]
        looked = bisect_right([at for at, _ in footage.looks], time)
        planned = bisect_right([at for at, _ in footage.plans], time)
        return cls(
            time,
            footage.looks[looked - 1][1] if looked else (),
            footage.plans[planned - 1][1] if planned else None,
            _counted(happened),
            _told(record, happened),
        )

    def add_to(self, scene: Any, unknown: Sequence[Box], crew: Sequence[CrewMember]) -> None:
        """Add unknown boxes, those that were sensed, and crew members to a `mujoco.MjvScene`."""
        for box in unknown:
            add_box(scene, box, UNKNOWN_OPACITY)
        for box in self.sensed:
            add_box(scene, box)
        for member in crew:
            middle = member.middles(np.array([self.time]))[0]
            for ends, radius in zip(*member.capsules, strict=True):
                add_capsule(scene, middle + ends, float(radius), rgba(CREW_COLOUR))


def _told(record: ClosedLoopRecord, happened: Sequence[Event]) -> str:
    """Return what happened last in a few words; at the end, also why it ended."""
    if happened and happened[-1].kind == "end":
        proof = ", with a proof that there is no plan" if record.proved else ""
        return f"{record.outcome}{proof}: {record.reason}"
    return "; ".join(event.line for event in happened if event.time == happened[-1].time)


def _counted(happened: Sequence[Event]) -> str:
    """Return the number of the step, and of all steps if those planned are taken."""
    done = sum(event.kind == "step" for event in happened)
    planned = [event.values["steps"] for event in happened if event.kind == "planned"][-1:]
    if (happened and happened[-1].kind == "end") or not planned:
        return f"{done} steps"
    return f"step {done + 1} of {done + planned[0]}"


@checked(
    {
        **ARGUMENTS,
        "record": InstanceOf(ClosedLoopRecord),
        "unknown": ListOf(InstanceOf(Box)),
        "crew": ListOf(InstanceOf(CrewMember)),
        "size": SIZE,
        "speed": OrNone(SPEED),
    }
)
def closed_loop_film(
    graph: StanceGraph,
    record: ClosedLoopRecord,
    path: str | Path,
    *,
    unknown: Sequence[Box] = (),
    crew: Sequence[CrewMember] = (),
    size: tuple[int, int] = DEFAULT_SIZE,
    speed: float | None = None,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Film a walk in the closed loop; the further arguments and errors are those of `film.film`.

    Shown are the boxes that the robot does not know, pale and with their ids; what it has sensed of
    them up to the time of the picture; the plan that it follows at that time; crew members who
    crossed the cabin; and captions with time, number of the step and what happened last.

    The graph is that of what the robot knew at the start, without obstacles that were gone; the
    record is that of a walk with `filmed=True`. Raises a `SettingError` if it has no footage, or
    the robot did not move.
    """
    check_film_format(path)
    if record.footage is None or not record.footage.recordings:
        why = "the walk was not filmed" if record.footage is None else "the robot did not move"
        raise SettingError(f"record has nothing to be shown: {why}")
    recording = record.footage.recording
    speed = default_speed(recording) if speed is None else speed
    samples = film_samples(recording, speed)
    labels = tuple(((*b.centre[:2], b.bounds[1, 2]), b.id, LABEL_COLOUR) for b in unknown)
    shots = []
    for k, time in zip(samples, [*recording.times[samples[:-1]], record.duration], strict=True):
        moment = Moment.of(record, float(time))
        route = None if moment.plan is None else Route.of(graph.grasp_map, moment.plan)
        draw = partial(moment.add_to, unknown=unknown, crew=crew)
        clock = f"{time:.0f} s of {record.duration:.0f} s (x{speed:g}), {moment.progress}"
        lines = clock, moment.news
        here = recording.configuration(int(k))
        shots.append(Shot(here, lines, route, draw=draw, labels=labels))
    pictures = film_pictures(
        graph.grasp_map, graph.robot, shots, size, graph.obstacles, progress=progress
    )
    save_film(pictures, path)
