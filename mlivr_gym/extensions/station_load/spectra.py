"""What a station feels of a walk: force, torque, impulses, and the spectrum of its acceleration.

Torques and angular impulses are about the origin of the module frame, the middle of the end of the
JEM at which Node 2 holds it. About another point p the torque is less by p x F, with the force F.

The station is taken for a rigid body that the force of all grasps accelerates; its elastic modes,
which amplify some frequencies, and its rotation are left out. MuJoCo conserves momentum up to an
error in proportion to the time step, so that impulses are as exact; forces are exact.

Limits of vibration for the International Space Station hold for the root mean square in each
one-third octave band over 100 s. `limits` has those of its microgravity control plan as NASA's
analysis of the station's accelerometers draws them (`otorunhist/main.py` of
github.com/baluneboy/pims by the Principal Investigator Microgravity Services): 1.8 micro-g up to
0.1 Hz, in proportion to the frequency up to 100 Hz, and 1800 micro-g from there on. The control
plan itself was not at hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array
from mlivr_gym.schema import Tuples
from mlivr_gym.simulation import Recording
from mlivr_gym.simulation.disturbances import STANDARD_GRAVITY

STATION_MASS = 420_000.0
"""Mass of the International Space Station [kg], rounded; NASA states 419,725 kg."""

WINDOW = 100.0
"""Time over which the root mean square is taken [s]."""

LOWEST_FREQUENCY = 0.01
"""Frequency below which no limit for vibration holds [Hz]."""

MASS = Tuples((), 1.0, 1e9, "kg")
"""Valid masses of a station."""


@checked()
def limits(frequencies: Array) -> Array:
    """Return the limit at the middles of one-third octave bands [Hz], as root mean square [g]."""
    allowed: Array = 18e-6 * np.clip(frequencies, 0.1, 100.0)
    return allowed


@dataclass(frozen=True)
class StationLoad:
    """The load of a walk on a station."""

    times: Array
    """Times, shape (k,) [s]."""
    forces: Array
    """Force on the module in the world, shape (k, 3) [N]."""
    torques: Array
    """Torque on the module about the origin of the module frame, shape (k, 3) [N m]."""
    peak_forces: Array
    """Largest force during each step, shape (s,) [N]."""
    peak_torques: Array
    """Largest torque during each step, shape (s,) [N m]."""
    impulses: Array
    """Largest impulse since the begin of each step, shape (s,) [N s]. Over a whole step, from rest
    to rest, it is close to 0."""
    angular_impulses: Array
    """Largest angular impulse since the begin of each step, shape (s,) [N m s]; also close to 0
    over a whole step."""
    frequencies: Array
    """Middles of the one-third octave bands, shape (b,) [Hz]."""
    accelerations: Array
    """Root mean square of the acceleration in each band, of all axes together, shape (b,) [g]; the
    largest over windows of `WINDOW`. In shorter walks the station is at rest for the remainder of
    the window."""

    @property
    def largest_ratio(self) -> float:
        """Largest ratio of the acceleration in a band to its limit."""
        return float((self.accelerations / limits(self.frequencies)).max())

    def to_dict(self) -> dict[str, Any]:
        """Return the load without its course in time as plain data for JSON."""
        return {
            "peak_forces_N": self.peak_forces.tolist(),
            "peak_torques_N_m": self.peak_torques.tolist(),
            "impulses_N_s": self.impulses.tolist(),
            "angular_impulses_N_m_s": self.angular_impulses.tolist(),
            "frequencies_Hz": self.frequencies.tolist(),
            "accelerations_g": self.accelerations.tolist(),
            "largest_ratio_to_limit": self.largest_ratio,
        }


@checked({"recording": InstanceOf(Recording), "mass": MASS})
def station_load(recording: Recording, mass: float = STATION_MASS) -> StationLoad:
    """Return the load of a simulated walk on the station in which it takes place.

    The mass is that of the station [kg].


    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> from mlivr_gym.planners import Planner
    >>> from mlivr_gym.simulation import execute
    >>> graph = stance_graph()
    >>> plan = Planner(graph).plan(("D2a:4", "D2b:4"), (3.0, 0.0, 0.42), cost="steps").unwrap()
    >>> load = station_load(execute(graph, plan).recording)
    >>> len(load.impulses) == len(plan.steps)
    True
    """
    times, forces, torques = recording.times, recording.module_forces, recording.module_torques
    parts = [np.flatnonzero(recording.step == step).tolist() for step in np.unique(recording.step)]
    period = float(np.diff(times).mean()) if len(times) > 1 else WINDOW
    impulses, turns = (
        _largest([cumulative_trapezoid(load[p], times[p], axis=0, initial=0.0) for p in parts])
        for load in (forces, torques)
    )
    frequencies, accelerations = third_octaves(forces / (mass * STANDARD_GRAVITY), period)
    return StationLoad(
        times, forces, torques,
        _largest([forces[p] for p in parts]),
        _largest([torques[p] for p in parts]),
        impulses, turns,
        frequencies, accelerations,
    )  # fmt: skip


def third_octaves(signal: Array, period: float) -> tuple[Array, Array]:
    """Return the middles of one-third octave bands [Hz] and the root mean square in each.

    Bands from `LOWEST_FREQUENCY` up to the highest frequency that the samples resolve are at ratios
    of the tenth root of 10 (IEC 61260-1). The samples have shape (k, 3), and `period` is the time
    between them [s].
    """
    count = max(round(WINDOW / period), 2)
    starts = range(0, max(len(signal) - count, 0) + count // 2, max(count // 2, 1))
    frequencies = np.fft.rfftfreq(count, period)
    edges = 10.0 ** (0.1 * (np.arange(-20, 30) - 0.5))
    edges = edges[edges <= frequencies[-1]]
    band = np.searchsorted(edges, frequencies) - 1
    inside = (band >= 0) & (band < len(edges) - 1)
    squares: list[Any] = [np.zeros(len(edges) - 1)]
    for start in starts:
        amplitudes = np.abs(np.fft.rfft(signal[start : start + count], count, axis=0)) / count
        power = 2.0 * (amplitudes**2).sum(axis=1)  # mean square of each frequency
        squares.append(np.bincount(band[inside], power[inside], len(edges) - 1))
    return np.sqrt(edges[1:] * edges[:-1]), np.sqrt(np.max(squares, axis=0))


def _largest(parts: list[Array]) -> Array:
    """Return the largest magnitude of the vectors of each of s parts (k, 3), shape (s,)."""
    return np.array([np.linalg.norm(part, axis=1).max() for part in parts])
