"""What a station feels of a walk: force, torque, impulses, and the spectrum of its acceleration."""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.station_load.load import load_figure
    from mlivr_gym.extensions.station_load.spectra import (
        STATION_MASS,
        StationLoad,
        limits,
        station_load,
    )

__all__ = ["STATION_MASS", "StationLoad", "limits", "load_figure", "station_load"]

COMMANDS = {
    "load": (
        "say what a station feels of an execution, and compare it with the limits",
        "mlivr-gym load walk",
    ),
}

__getattr__, __dir__ = lazy(__name__)
