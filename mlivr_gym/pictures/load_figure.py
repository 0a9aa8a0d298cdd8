"""Figure of what a station feels of a walk: force and torque over time, and spectrum."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mlivr_gym.pictures.figures import new_figure, save_figure
from mlivr_gym.simulation.station_load import StationLoad, limits

AXES = (("x", "#c1121f"), ("y", "#2a9d3a"), ("z", "#1f5fd0"))
"""Axes of the world and their colours."""


def load_figure(load: StationLoad, path: str | Path, title: str) -> None:
    """Draw the load of a walk on a station, as PNG and as SVG of the same name."""
    figure = new_figure(11.0, 5.0)
    parts = figure.subplot_mosaic([["force", "spectrum"], ["torque", "spectrum"]])
    spectrum = parts["spectrum"]
    for part, values, unit in (("force", load.forces, "N"), ("torque", load.torques, "N m")):
        for k, (name, colour) in enumerate(AXES):
            parts[part].plot(load.times, values[:, k], color=colour, linewidth=1.0, label=name)
        parts[part].set(ylabel=f"{part} [{unit}]")
        parts[part].margins(x=0.0)
    parts["torque"].set(xlabel="time [s]")
    parts["force"].legend(fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    there = load.accelerations > 0.0
    allowed = 1e6 * limits(load.frequencies)
    spectrum.step(load.frequencies, allowed, where="mid", color="0.3", label="limit")
    spectrum.loglog(
        load.frequencies[there], 1e6 * load.accelerations[there], "o-", markersize=3,
        color="#e07b00", label="walk",
    )  # fmt: skip
    spectrum.set_ylim(1e-6 * np.ceil(1e6 * 1e-3 * allowed.min()), 3.0 * allowed.max())
    spectrum.set(
        xlabel="middle of the one-third octave band [Hz]",
        ylabel="acceleration, RMS over 100 s [micro-g]",
    )
    spectrum.legend(fontsize=8)
    for axis in parts.values():
        axis.grid(alpha=0.3)
    figure.suptitle(title, fontsize=10)
    save_figure(figure, path)
