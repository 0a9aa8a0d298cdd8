"""Film of a closed loop: what the robot has seen, what is there, its plan, and what happens."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.closed_loop.record import ClosedLoopRecord
from mlivr_gym.pictures import Route, Shot, check_film_format, film_pictures, save_film
from mlivr_gym.pictures.films import DEFAULT_SIZE, FILM, default_speed, film_samples
from mlivr_gym.pictures.scene_shapes import add_box
from mlivr_gym.schema import ListOf
from mlivr_gym.stances import StanceGraph
from mlivr_gym.world import Box

UNKNOWN_OPACITY = 0.25
"""Opacity of a box that the robot does not know, relative to one that it has seen."""


def news_at(record: ClosedLoopRecord, time: float) -> str:
    """Return what happened last before a time [s] in a few words; at the end, also why it ended."""
    happened = [event for event in record.events if event.time <= time]
    if happened and happened[-1].kind == "end":
        proof = ", with a proof that there is no plan" if record.proved else ""
        return f"{record.outcome}{proof}: {record.reason}"
    return "; ".join(event.line for event in happened if event.time == happened[-1].time)


def _add_boxes(scene: Any, unknown: Sequence[Box], sensed: Sequence[Box]) -> None:
    """Add boxes that are unknown and that were sensed."""
    for box in unknown:
        add_box(scene, box, UNKNOWN_OPACITY)
    for box in sensed:
        add_box(scene, box)


@checked(
    {
        **FILM,
        "record": InstanceOf(ClosedLoopRecord),
        "unknown": ListOf(InstanceOf(Box)),
    }
)
def closed_loop_film(
    graph: StanceGraph,
    record: ClosedLoopRecord,
    path: str | Path,
    *,
    unknown: Sequence[Box] = (),
    size: tuple[int, int] = DEFAULT_SIZE,
    speed: float | None = None,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Film a walk in the closed loop; the further arguments and errors are those of `film.film`.

    Shown are the boxes that the robot does not know, pale; what it has sensed of
    them up to the time of the picture; the plan that it follows at that time; and captions with
    time and what happened last.

    The graph is that of what the robot knew at the start; the record is that of a walk with
    `filmed=True`. Raises a `SettingError` if it has no footage, or
    the robot did not move.
    """
    check_film_format(path)
    if record.footage is None or not record.footage.recordings:
        why = "the walk was not filmed" if record.footage is None else "the robot did not move"
        raise SettingError(f"record has nothing to be shown: {why}")
    footage, recording = record.footage, record.footage.recording
    speed = default_speed(recording) if speed is None else speed
    samples = film_samples(recording, speed)
    shots = []
    for k, time in zip(samples, [*recording.times[samples[:-1]], record.duration], strict=True):
        seen = [boxes for at, boxes in footage.looks if at <= time]
        followed = [plan for at, plan in footage.plans if at <= time]
        sensed = seen[-1] if seen else ()
        draw = partial(_add_boxes, unknown=unknown, sensed=sensed)
        clock = f"{time:.0f} s of {record.duration:.0f} s (x{speed:g})"
        route = Route.of(graph.grasp_map, followed[-1]) if followed else None
        here, lines = recording.configuration(int(k)), (clock, news_at(record, time))
        shots.append(Shot(here, lines, route, draw=draw))
    pictures = film_pictures(
        graph.grasp_map, graph.robot, shots, size, graph.obstacles, progress=progress
    )
    save_film(pictures, path)
