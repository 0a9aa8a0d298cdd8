"""The command `mlivr-gym load`: what a station feels of an execution, in words and as a figure."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.cli.arguments import option
from mlivr_gym.cli.outputs import check_outputs
from mlivr_gym.errors import path_shown
from mlivr_gym.extensions.station_load.spectra import (
    MASS,
    STATION_MASS,
    StationLoad,
    limits,
    station_load,
)
from mlivr_gym.files import FileError
from mlivr_gym.pictures import new_figure, save_figure
from mlivr_gym.schema import FieldPath, Numbers
from mlivr_gym.simulation import Recording

FILES = ("station.png", "station.svg")
"""Files that the command writes."""

AXES = (("x", "#c1121f"), ("y", "#2a9d3a"), ("z", "#1f5fd0"))
"""Axes of the world and their colours."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    parser.add_argument("folder", metavar="FOLDER", help="what `mlivr-gym simulate` has written")
    option(parser, "--mass KG", "mass of the station", STATION_MASS, MASS)


def run(args: argparse.Namespace) -> None:
    """Say what a station feels of an execution, compare it with the limits, and draw it."""
    folder = Path(args.folder)
    recording = load_recording(folder / "simulation.npz")
    check_outputs(*(folder / name for name in FILES), folder=folder)
    load = station_load(recording, args.mass)
    print(
        f"a station of {args.mass:,.0f} kg feels at most {load.peak_forces.max():.1f} N and an "
        f"impulse of {load.impulses.max():.1f} N s,\n"
        f"  {load.peak_torques.max():.1f} N m about the origin of the module and an angular "
        f"impulse of {load.angular_impulses.max():.1f} N m s;\n"
        f"  its acceleration is at most {load.largest_ratio:.2f} times the limit of a one-third "
        "octave band"
    )
    title = f"{len(load.impulses)} steps, {args.mass:,.0f} kg"
    load_figure(load, folder / FILES[0], title)
    print(f"load on the station: {folder / FILES[0]}, {folder / FILES[1]}")
    args.result |= load.to_dict() | {"files": FILES}


def load_recording(path: Path) -> Recording:
    """Return the recording of an execution; raises a `FileError` if it cannot be read."""
    place = FieldPath(f"simulation {path_shown(path)}", FileError)
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as data:
            arrays: dict[str, Any] = {field.name: data[field.name] for field in fields(Recording)}
    except Exception as error:  # NumPy, zipfile and zlib raise errors of many kinds
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FileError(f"cannot read simulation {str(path)!r}: {reason}") from None
    count = arrays["times"].size
    shapes = {"times": (), "step": (), "module_forces": (3,), "module_torques": (3,)}
    for name, shape in shapes.items():
        Numbers((count, *shape)).read(arrays[name], place.field(name))
    return Recording(**arrays)


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
