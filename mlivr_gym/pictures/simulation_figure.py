"""Figure of a simulated walk: joint torques, grasp forces and base error over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.pictures.figures import save_figure
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.simulation.recording import Capture, Failure, Recording


def simulation_figure(
    recording: Recording,
    captures: tuple[Capture, ...],
    failure: Failure | None,
    path: str | Path,
    title: str,
) -> None:
    """Draw a recording over time; departures and approaches are shaded, captures marked.

    Args:
        recording: Measurements.
        captures: When limbs grasped their points.
        failure: Why the walk ended early, or None.
        path: PNG file to write.
        title: Heading.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 8.6), dpi=110)
    FigureCanvasAgg(figure)
    axes: list[Any] = figure.subplots(4, 1, sharex=True).tolist()
    times, limbs = recording.times, recording.joint_torques.shape[1]
    axes[0].plot(times, recording.torque_rms, color="#c1121f", linewidth=1.4)
    axes[0].set_ylabel("torque, RMS over\nall joints [N m]")
    for limb in range(limbs):
        style = {"color": LIMB_COLOURS[limb], "linewidth": 1.2, "label": f"limb {limb}"}
        axes[1].plot(times, np.abs(recording.joint_torques[:, limb]).max(axis=1), **style)
        axes[2].plot(times, np.linalg.norm(recording.grasp_forces[:, limb], axis=1), **style)
    axes[1].set_ylabel("largest joint\ntorque [N m]")
    axes[2].set_ylabel("grasp force [N]")
    axes[3].plot(times, 1e3 * recording.base_errors, color="0.25", linewidth=1.2)
    axes[3].set_ylabel("base error [mm]")
    axes[3].set_xlabel("time [s]")
    for k, panel in enumerate(axes):
        _mark_events(panel, recording, captures, failure, named=k == 0)
        panel.set_ylim(bottom=0.0)
        panel.margins(x=0.0)
        panel.grid(alpha=0.25)
    axes[0].legend(loc="upper right", fontsize=8.5, ncols=2, frameon=False)
    axes[1].legend(loc="upper right", fontsize=8.5, ncols=limbs, frameon=False)
    figure.suptitle(title, x=0.02, y=0.985, ha="left", fontsize=13, parse_math=False)
    if failure is not None:
        figure.text(
            0.02,
            0.945,
            f"failed at {failure.time:.2f} s: {failure.message}",
            fontsize=9.5,
            color="#a00000",
            parse_math=False,
        )
    figure.subplots_adjust(left=0.09, right=0.985, bottom=0.06, top=0.925, hspace=0.12)
    save_figure(figure, path)


def _mark_events(
    panel: Any,
    recording: Recording,
    captures: tuple[Capture, ...],
    failure: Failure | None,
    *,
    named: bool,
) -> None:
    """Shade departures and approaches, and mark captures and the failure.

    The legend names what is shaded if `named`.
    """
    for phase, colour, name in ((0, "#dfe9f3", "departure"), (2, "#f7e6d3", "approach")):
        panel.fill_between(
            recording.times,
            0.0,
            1.0,
            where=recording.phase == phase,
            color=colour,
            linewidth=0.0,
            zorder=0,
            transform=panel.get_xaxis_transform(),
            label=name if named else None,
        )
    for capture in captures:
        panel.axvline(capture.time, color="0.55", linewidth=0.7, linestyle=":")
    if failure is not None:
        panel.axvline(failure.time, color="#d00000", linewidth=1.4)
