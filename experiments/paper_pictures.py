"""Pictures of the study of the paper's figures: torques with both swings, and paths."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from arrivals import Measured

from mlivr_gym.arrays import Array
from mlivr_gym.motion.clocks import Durations
from mlivr_gym.pictures.figures import BASE_COLOUR, save_figure, tints
from mlivr_gym.pictures.simulation_figure import PART_MARKS, SHADES, mark_phases, scale_torques
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.simulation.execution import Execution
from mlivr_gym.simulation.phase_torques import CAPTURE, largest, phase_torques
from mlivr_gym.world.grasp_map import GraspMap

GAP = 2.0
"""Time between two steps in the figure of torques, which are carried out one by one [s]."""


@dataclass(frozen=True)
class WalkPaths:
    """Where base and grippers were planned and are, at k times.

    Attributes:
        times: Shape (k,) [s].
        planned: Base and grasp point of each limb, shape (k, 1 + N, 3) [m].
        actual: The same as simulated, shape (k, 1 + N, 3) [m].
    """

    times: Array
    planned: Array
    actual: Array

    @property
    def names(self) -> list[str]:
        """Names of what is followed, 1 + N."""
        return ["base", *(f"gripper {limb}" for limb in range(self.planned.shape[1] - 1))]

    @property
    def colours(self) -> list[str]:
        """Their colours."""
        return [BASE_COLOUR, *LIMB_COLOURS[: self.planned.shape[1] - 1]]

    @property
    def deviations(self) -> Array:
        """Distance of actual from planned, shape (k, 1 + N) [m]."""
        off: Array = np.linalg.norm(self.actual - self.planned, axis=2)
        return off


def _figure(width: float, height: float) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110)
    FigureCanvasAgg(figure)
    return figure


def torque_figure(measured: dict[tuple[str, str], list[Measured]], path: str | Path) -> None:
    """Torques over time of Case 3's steps: a panel for each swing and controller.

    Args:
        measured: By swing and controller, one entry a step.
        path: PNG file to write.
    """
    figure = _figure(12.0, 9.6)
    panels: list[Any] = figure.subplots(len(measured), 1, sharex=True, sharey=True).tolist()
    most = max(
        float(done.recording.torque_rms.max()) for steps in measured.values() for done in steps
    )
    scale_torques(panels[0], most)
    for panel, ((swing, controller), steps) in zip(panels, measured.items(), strict=True):
        begin = 0.0
        for number, done in enumerate(steps):
            _step_torques(panel, done, begin)
            if panel is panels[0]:
                panel.text(
                    begin + 25.0, 1.03, f"step {number + 1}", ha="center", fontsize=9,
                    transform=panel.get_xaxis_transform(),
                )  # fmt: skip
            begin += 50.0 + GAP
        panel.set_ylabel("torque RMS [N m]")
        panel.set_title(
            f"swing in {swing}, {controller}", fontsize=10, loc="left", x=0.005, y=0.84,
            bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0.0, "pad": 1.5},
        )  # fmt: skip
        panel.grid(alpha=0.25)
    panels[-1].set_xlim(0.0, begin + 4.0)
    panels[-1].set_xlabel("time [s]; each step from rest in its stance, and 1 s after its capture")
    _torque_legend(figure)
    figure.suptitle(
        "Case 3: RMS over all joint torques, 50 s a step, logarithmic", x=0.02, y=0.985,
        ha="left", fontsize=13,
    )  # fmt: skip
    figure.subplots_adjust(left=0.075, right=0.985, bottom=0.055, top=0.90, hspace=0.10)
    save_figure(figure, path)


def _step_torques(panel: Any, done: Measured, begin: float) -> None:
    """Torques of one step from `begin` on, with the peak of each part marked.

    What lies below the axis is marked at its foot.
    """
    foot = 1.35 * panel.get_ylim()[0]
    recording = replace(done.recording, times=done.recording.times + begin)
    captures = tuple(
        replace(capture, time=capture.time + begin, step=int(recording.step[0]))
        for capture in done.captures
    )
    mark_phases(panel, recording, captures)
    # So many samples are an image in the SVG.
    panel.plot(recording.times, recording.torque_rms, color="0.15", linewidth=1.1, rasterized=True)
    torques = phase_torques(recording, captures)
    best = largest(torques, torques[0].step)
    for entry in torques:
        marker, colour = PART_MARKS[entry.part]
        full = entry == best
        face, size = (colour, 6.5) if full else ("white", 4.5)
        style = {"color": colour, "markerfacecolor": face, "markersize": size, "zorder": 5}
        height = max(entry.peak, foot)
        panel.plot(entry.time, height, marker=marker, **style)
        if full or entry.part == CAPTURE:
            panel.annotate(
                f"{entry.peak:.2g}" if entry.peak > foot else f"{entry.peak:.0e}",
                (entry.time, height), (0, 6), textcoords="offset points", ha="center", fontsize=8,
                zorder=6, bbox={"facecolor": "white", "alpha": 0.7, "linewidth": 0.0, "pad": 0.6},
            )  # fmt: skip


def _torque_legend(figure: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(facecolor=colour, edgecolor="0.45", linewidth=0.6, label=name)
        for name, colour in SHADES.values()
    ]
    for part, (marker, colour) in PART_MARKS.items():
        label = "peak in the second after capture" if part == CAPTURE else f"peak in {part}"
        handles.append(
            Line2D([], [], marker=marker, color=colour, linestyle="none", markerfacecolor="white",
                   markersize=5.5, label=label)
        )  # fmt: skip
    figure.legend(
        handles=handles, loc="upper right", bbox_to_anchor=(0.985, 0.995), ncols=3, fontsize=8.5,
        frameon=False, title="filled: largest of the step", title_fontsize=8.5, alignment="right",
    )  # fmt: skip


def paths_figure(
    grasp_map: GraspMap, walks: dict[str, tuple[Execution, WalkPaths]], path: str | Path
) -> None:
    """Planned and actual paths of base and grippers, from the side and from above, and errors.

    Args:
        grasp_map: The map.
        walks: The walk and its paths by controller; the first one's paths are drawn.
        path: PNG file to write.
    """
    _, paths = next(iter(walks.values()))
    figure = _figure(12.8, 10.6)
    side = figure.add_axes((0.07, 0.665, 0.60, 0.27))
    above = figure.add_axes((0.07, 0.365, 0.60, 0.27))
    zoom = figure.add_axes((0.735, 0.40, 0.25, 0.50))
    errors = figure.add_axes((0.07, 0.055, 0.915, 0.25))
    for panel, (a, b), name in ((side, (0, 2), "from the side"), (above, (0, 1), "from above")):
        _draw_paths(panel, grasp_map, paths, (a, b))
        panel.set_title(name, fontsize=10, loc="left", color="0.25")
    _draw_zoom(zoom, side, grasp_map, paths)
    _draw_errors(errors, walks)
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, linewidth=2.0, label=name)
        for name, colour in zip(paths.names, paths.colours, strict=True)
    ]
    handles += [
        Line2D([], [], color="0.2", linestyle=(0, (4, 2)), linewidth=1.4, label="planned"),
        Line2D([], [], color="0.2", linewidth=1.8, label="actual"),
    ]
    figure.legend(
        handles=handles, loc="upper right", bbox_to_anchor=(0.985, 0.995), ncols=5, fontsize=9,
        frameon=False,
    )  # fmt: skip
    figure.suptitle(
        f"Case 3 with the paper's controller, {Durations().total:g} s a step: planned and "
        "actual paths",
        x=0.02, y=0.985, ha="left", fontsize=13,
    )  # fmt: skip
    save_figure(figure, path)


def _draw_paths(panel: Any, grasp_map: GraspMap, paths: WalkPaths, axes: tuple[int, int]) -> None:
    """Paths in one plane at equal scale."""
    a, b = axes
    points = grasp_map.positions
    panel.scatter(points[:, a], points[:, b], s=5, color=tints(grasp_map), zorder=1)
    for n, colour in reversed(list(enumerate(paths.colours))):
        there, planned = paths.actual[:, n], paths.planned[:, n]
        panel.plot(there[:, a], there[:, b], color=colour, linewidth=2.4, alpha=0.55, zorder=3)
        panel.plot(
            planned[:, a], planned[:, b], color="0.1", linewidth=0.9, linestyle=(0, (4, 2)),
            zorder=4,
        )  # fmt: skip
        panel.plot(*there[0, [a, b]], marker="o", color=colour, markersize=6, zorder=5)
        panel.plot(*there[-1, [a, b]], marker="s", color=colour, markersize=6, zorder=5)
    panel.set_aspect("equal")
    panel.set_xlabel(f"{'xyz'[a]} [m]", labelpad=1)
    panel.set_ylabel(f"{'xyz'[b]} [m]", labelpad=1)
    panel.grid(alpha=0.2)


def _draw_zoom(panel: Any, side: Any, grasp_map: GraspMap, paths: WalkPaths) -> None:
    """The side view where the base is farthest off."""
    from matplotlib.patches import Rectangle

    worst = int(paths.deviations[:, 0].argmax())
    x, z = paths.planned[worst, 0, [0, 2]]
    width, height = 0.36, 0.62
    _draw_paths(panel, grasp_map, paths, (0, 2))
    panel.set_xlim(x - width / 2, x + width / 2)
    panel.set_ylim(z - height / 2, z + height / 2)
    both = np.stack([paths.planned[worst, 0], paths.actual[worst, 0]])
    panel.plot(both[:, 0], both[:, 2], color="black", linewidth=1.2, marker=".", zorder=6)
    off = 1e3 * paths.deviations[worst, 0]
    panel.annotate(
        f"base {off:.0f} mm off\nat {paths.times[worst]:.1f} s", both[:, [0, 2]].mean(axis=0),
        (12, 26), textcoords="offset points", fontsize=9,
        arrowprops={"arrowstyle": "-", "linewidth": 0.8},
        bbox={"facecolor": "white", "alpha": 0.85, "linewidth": 0.0, "pad": 1.5}, zorder=7,
    )  # fmt: skip
    panel.set_title("from the side, enlarged", fontsize=10, loc="left", color="0.25")
    frame = Rectangle(
        (x - width / 2, z - height / 2), width, height, fill=False, edgecolor="black", zorder=6
    )
    side.add_patch(frame)


def _draw_errors(panel: Any, walks: dict[str, tuple[Execution, WalkPaths]]) -> None:
    """Distances of actual from planned over time; of all walks but the first that of the base."""
    execution, first = next(iter(walks.values()))
    mark_phases(panel, execution.recording, execution.captures, execution.failure)
    for number, (name, (_, paths)) in enumerate(walks.items()):
        off = np.maximum(1e3 * paths.deviations, 1e-6)
        drawn = paths.colours[: 1 if number else None]
        for n, colour in reversed(list(enumerate(drawn))):
            style = {"linewidth": 0.9 if number else 1.4, "linestyle": ":" if number else "-"}
            panel.plot(paths.times, off[:, n], color=colour, **style)
        worst = int(off[:, 0].argmax())
        panel.annotate(
            f"{name}:\nbase at most {off[worst, 0]:.2g} mm", (paths.times[worst], off[worst, 0]),
            (-205 if number else 75, 7 if number else -1), textcoords="offset points",
            fontsize=8.5,
            arrowprops={"arrowstyle": "-", "linewidth": 0.7},
            bbox={"facecolor": "white", "alpha": 0.85, "linewidth": 0.0, "pad": 1.5}, zorder=7,
        )  # fmt: skip
    panel.set_yscale("log")
    panel.set_ylim(2e-3, 4e3 * first.deviations.max())
    panel.yaxis.set_major_formatter("{x:g}")
    panel.set_ylabel("distance of actual from\nplanned, log axis [mm]")
    panel.set_xlabel(
        "time [s]; solid: the paper's controller, dotted: base with feedforward; departures blue, "
        "approaches orange, captures dotted", labelpad=1,
    )  # fmt: skip
    panel.set_xlim(0.0, first.times[-1])
    panel.grid(alpha=0.25)
