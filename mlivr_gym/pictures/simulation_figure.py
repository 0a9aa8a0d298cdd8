"""Figure of an execution in simulation: joint torques, grasp forces and base error over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.pictures.figures import new_figure, save_figure
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.simulation.phase_torques import (
    CAPTURE,
    CAPTURE_TIME,
    PARTS,
    after_captures,
    largest,
    phase_torques,
)
from mlivr_gym.simulation.recording import Capture, Failure, Recording

SHADES = {0: ("departure", "#c6d9ed"), 2: ("approach", "#f6dcba")}
"""Name and background colour of the phases that are shaded, by index."""

_MARKS = (("<", "#1f5fd0"), ("o", "#6a3d9a"), (">", "#e07b00"), ("D", "#c1121f"))
PART_MARKS = dict(zip(PARTS, _MARKS, strict=True))
"""Marker and colour of the peak in each part of a step."""

SPIKE = 2.0
"""Values just after a capture are cut off if they exceed all others by more than this factor."""

DECADES = 2.7
"""Decades of the torque axis below the largest value."""


def simulation_figure(
    recording: Recording,
    captures: tuple[Capture, ...],
    failure: Failure | None,
    path: str | Path,
    title: str,
) -> None:
    """Draw a recording over time, as PNG and as SVG of the same name.

    Departures and approaches are shaded, captures are dotted lines. On a logarithmic axis, marks
    show the largest torque in each part of a step. A spike at a capture is cut off, and its height
    is written.
    """
    figure = new_figure(11.0, 9.0)
    axes: list[Any] = figure.subplots(4, 1, sharex=True).tolist()
    times, limbs = recording.times, recording.joint_torques.shape[1]
    forces = np.linalg.norm(recording.grasp_forces, axis=2)
    torques = np.abs(recording.joint_torques).max(axis=2)
    errors = 1e3 * recording.base_errors
    axes[0].plot(times, recording.torque_rms, color="0.15", linewidth=1.2)
    for limb in range(limbs):
        style = {"color": LIMB_COLOURS[limb], "linewidth": 1.2, "label": f"limb {limb}"}
        axes[1].plot(times, torques[:, limb], **style)
        axes[2].plot(times, forces[:, limb], **style)
    axes[3].plot(times, errors, color="0.25", linewidth=1.2)
    named = (
        "torque, RMS over all\njoints, log axis [N m]",
        "largest joint\ntorque [N m]",
        "grasp force [N]",
    )
    for panel, name in zip(axes, (*named, "base error [mm]"), strict=True):
        panel.set_ylabel(name)
        mark_phases(panel, recording, captures, failure)
        panel.margins(x=0.0)
        panel.grid(alpha=0.25)
    follows_capture = after_captures(recording, captures)
    for panel, values in zip(
        axes[1:], (torques.max(axis=1), forces.max(axis=1), errors), strict=True
    ):
        cut_spikes(panel, times, values, follows_capture, captures)
    scale_torques(axes[0], float(recording.torque_rms.max()) or 1.0)
    _mark_peaks(axes[0], recording, captures)
    axes[3].set_xlabel("time [s]")
    axes[1].legend(loc="best", fontsize=8.5, ncols=limbs, framealpha=0.85)
    _head(figure, axes[0], title, failure)
    save_figure(figure, path)


def mark_phases(
    panel: Any, recording: Recording, captures: tuple[Capture, ...], failure: Failure | None = None
) -> None:
    """Shade departures and approaches, and mark captures and the failure with lines."""
    for phase, (_, colour) in SHADES.items():
        shaded = np.concatenate([[False], recording.phase == phase, [False]])
        first, after = np.flatnonzero(np.diff(shaded.astype(np.int8))).reshape(-1, 2).T
        for begin, end in zip(recording.times[first], recording.times[after - 1], strict=True):
            panel.axvspan(begin, end, color=colour, linewidth=0.0, zorder=0)
    for capture in captures:
        panel.axvline(capture.time, color="0.35", linewidth=0.8, linestyle=":")
    if failure is not None:
        panel.axvline(failure.time, color="#d00000", linewidth=1.4)


def scale_torques(panel: Any, maximum: float) -> None:
    """Set a logarithmic axis up to a maximum [N m], since steps differ by powers of ten."""
    panel.set_yscale("log")
    panel.set_ylim(maximum * 10.0**-DECADES, 3.5 * maximum)
    panel.yaxis.set_major_formatter("{x:g}")


def cut_spikes(
    panel: Any,
    times: Array,
    values: Array,
    follows_capture: BoolArray,
    captures: tuple[Capture, ...],
) -> None:
    """Fit the axis of a panel to its values; cut off the spikes at captures and write their height.

    Times [s], values, and whether these follow a capture have shape (k,).
    """
    usual = float(values[~follows_capture].max(initial=0.0))
    if values.max() <= SPIKE * usual:
        panel.set_ylim(0.0, 1.15 * float(values.max()) or 1.0)
        return
    top = 1.45 * usual
    panel.set_ylim(0.0, top)
    for capture in captures:
        since = times - capture.time
        spike = float(values[(since > -1e-9) & (since < CAPTURE_TIME)].max(initial=0.0))
        if spike > top:
            last = capture.time > 0.93 * times[-1]
            panel.annotate(
                f"\u2191 {spike:.3g}",
                (capture.time, top),
                (-4 if last else 4, -11),
                textcoords="offset points",
                ha="right" if last else "left",
                fontsize=8.5,
            )


def _mark_peaks(panel: Any, recording: Recording, captures: tuple[Capture, ...]) -> None:
    """Mark the largest torque in each part of a step; that of the step is filled and labelled."""
    torques = phase_torques(recording, captures)
    best = {step: largest(torques, step) for step in {entry.step for entry in torques}}
    for entry in torques:
        marker, colour = PART_MARKS[entry.part]
        first = entry == best[entry.step]
        panel.plot(
            entry.time,
            entry.peak,
            marker=marker,
            color=colour,
            markersize=6.5 if first else 4.5,
            markerfacecolor=colour if first else "white",
            zorder=5,
        )
        if first:
            label_style = {"textcoords": "offset points", "ha": "center", "fontsize": 8.5}
            panel.annotate(f"{entry.peak:.2f}", (entry.time, entry.peak), (0, 7), **label_style)


def _head(figure: Any, panel: Any, title: str, failure: Failure | None) -> None:
    """Write the heading and the failure, and the legend of shades and marks."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(facecolor=colour, edgecolor="0.45", linewidth=0.6, label=name)
        for name, colour in SHADES.values()
    ]
    for part, (marker, colour) in PART_MARKS.items():
        label = f"peak in the second after {CAPTURE}" if part == CAPTURE else f"peak in {part}"
        style: dict[str, Any] = {"marker": marker, "color": colour, "linestyle": "none"}
        handles.append(
            Line2D([], [], label=label, markerfacecolor="white", markersize=5.5, **style)
        )
    panel.legend(
        handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.01), ncols=3, fontsize=8.5,
        frameon=False, title="filled: largest of the step", title_fontsize=8.5, alignment="right",
    )  # fmt: skip
    figure.suptitle(title, x=0.02, y=0.985, ha="left", fontsize=13, parse_math=False)
    if failure is not None:
        text = f"failed at {failure.time:.2f} s: {failure.message}"
        figure.text(0.02, 0.905, text, fontsize=9.5, color="#a00000", parse_math=False)
    figure.subplots_adjust(left=0.09, right=0.985, bottom=0.06, top=0.895, hspace=0.12)
