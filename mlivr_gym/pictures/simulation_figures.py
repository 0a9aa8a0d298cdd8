"""Figure of an execution in simulation over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.pictures.figures import new_figure, save_figure
from mlivr_gym.robot.visuals import LIMB_COLOURS
from mlivr_gym.simulation.recording import Capture, Failure, Recording

SHADES = {0: ("departure", "#c6d9ed"), 2: ("approach", "#f6dcba")}
"""Name and background colour of the phases that are shaded, by index."""

CAPTURE_TIME = 1.0
"""Time after a capture in which its spike is sought [s]; a grasp with the parameters of `Physics`
comes to rest with a time constant of 0.15 s."""

SPIKE = 2.0
"""Values just after a capture are cut off if they exceed all others by more than this factor."""

DECADES = 2.7
"""Decades of the torque axis below the largest value."""

Captures = tuple[Capture, ...]


def simulation_figure(
    recording: Recording, captures: Captures, failure: Failure | None, path: str | Path, title: str
) -> None:
    """Draw a recording over time, as PNG and as SVG of the same name.

    Departures and approaches are shaded, captures are dotted lines. A spike at a capture is cut
    off, and its height is written.
    """
    figure = new_figure(11.0, 9.0)
    panels: list[Any] = figure.subplots(4, 1, sharex=True).tolist()
    torques, times = np.abs(recording.joint_torques).max(axis=2), recording.times
    forces = np.linalg.norm(recording.grasp_forces, axis=2)
    panels[0].plot(times, recording.torque_rms, color="0.15", linewidth=1.2)
    for limb, colour in zip(range(torques.shape[1]), LIMB_COLOURS, strict=False):
        style = {"color": colour, "linewidth": 1.2, "label": f"limb {limb}"}
        panels[1].plot(times, torques[:, limb], **style)
        panels[2].plot(times, forces[:, limb], **style)
    panels[3].plot(times, 1e3 * recording.base_errors, color="0.25", linewidth=1.2)
    for panel in panels[1:]:
        values = np.max([line.get_ydata() for line in panel.lines], axis=0)
        _cut_spikes(panel, times, values, captures)
    panels[1].legend(loc="best", fontsize=8.5, ncols=torques.shape[1], framealpha=0.85)
    highest = float(recording.torque_rms.max()) or 1.0
    panels[0].set_yscale("log")  # steps differ by powers of ten
    panels[0].set_ylim(highest * 10.0**-DECADES, 3.5 * highest)
    panels[0].yaxis.set_major_formatter("{x:g}")
    named = "torque, RMS over all\njoints, log axis [N m]", "largest joint\ntorque [N m]"
    for panel, name in zip(panels, (*named, "grasp force [N]", "base error [mm]"), strict=True):
        panel.set_ylabel(name)
        panel.margins(x=0.0)
        panel.grid(alpha=0.25)
        _mark_phases(panel, recording, captures, failure)
    panels[0].legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.01), ncols=2, fontsize=8.5, frameon=False
    )
    panels[3].set_xlabel("time [s]")
    figure.suptitle(title, x=0.02, y=0.985, ha="left", fontsize=13, parse_math=False)
    if failure is not None:
        text = f"failed at {failure.time:.2f} s: {failure.message}"
        figure.text(0.02, 0.905, text, fontsize=9.5, color="#a00000", parse_math=False)
    figure.subplots_adjust(left=0.09, right=0.985, bottom=0.06, top=0.895, hspace=0.12)
    save_figure(figure, path)


def _mark_phases(
    panel: Any, recording: Recording, captures: Captures, failure: Failure | None
) -> None:
    """Shade departures and approaches, and mark captures and the failure with lines."""
    for phase, (name, colour) in SHADES.items():
        shaded = np.concatenate([[False], recording.phase == phase, [False]])
        first, after = np.flatnonzero(np.diff(shaded.astype(np.int8))).reshape(-1, 2).T
        for k, (begin, end) in enumerate(zip(first, after - 1, strict=True)):
            span, style = recording.times[[begin, end]], {"color": colour, "linewidth": 0.0}
            panel.axvspan(*span, zorder=0, label=None if k else name, **style)
    for capture in captures:
        panel.axvline(capture.time, color="0.35", linewidth=0.8, linestyle=":")
    if failure is not None:
        panel.axvline(failure.time, color="#d00000", linewidth=1.4)


def _cut_spikes(panel: Any, times: Array, values: Array, captures: Captures) -> None:
    """Fit the axis of a panel to its values; cut off the spikes at captures and write their height.

    Times [s] and values have shape (k,).
    """
    follows = [_after(times, capture) for capture in captures]
    usual = float(values[~np.any(follows, axis=0)].max(initial=0.0)) if follows else values.max()
    is_cut = values.max() > SPIKE * usual
    top = 1.45 * usual if is_cut else 1.15 * float(values.max()) or 1.0
    panel.set_ylim(0.0, top)
    for capture, caught in zip(captures, follows, strict=True) if is_cut else ():
        spike = float(values[caught].max(initial=0.0))
        if spike > top:
            ha, shift = ("right", -4) if capture.time > 0.93 * times[-1] else ("left", 4)
            style = {"textcoords": "offset points", "ha": ha, "fontsize": 8.5}
            panel.annotate(f"\u2191 {spike:.3g}", (capture.time, top), (shift, -11), **style)


def _after(times: Array, capture: Capture) -> BoolArray:
    """Return which times lie within `CAPTURE_TIME` after a capture, shape (k,)."""
    since = times - capture.time
    # Times are multiples of the time step up to rounding.
    inside: BoolArray = (since > -1e-9) & (since < CAPTURE_TIME - 1e-9)
    return inside
