"""Trajectories: steps with a clock.

Each piece of a step runs from rest to rest on its clock, so that velocity and acceleration vanish
at every corner of the path that was checked and the path itself is kept exactly.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import PlanError, SettingError, one_line
from mlivr_gym.files import write_whole
from mlivr_gym.kinematics.arm import LIMIT_TOLERANCE
from mlivr_gym.motion.clocks import duration_of
from mlivr_gym.motion.pieces import Piece
from mlivr_gym.motion.regrasp import PHASES, RegraspPath
from mlivr_gym.schema import NAME, Listed, Numbers, Place
from mlivr_gym.values import LONGEST, MOST_POINTS

FREE = -1
"""Grasp state of a limb that holds nothing."""

MOST_SAMPLES = 1_000_000
"""Most samples of a step's trajectory, half an hour at 2 ms; they take about a gigabyte."""


class TimedPath(NamedTuple):
    """A step with a clock for each of its pieces."""

    path: RegraspPath
    pieces: tuple[Piece, ...]
    clocks: tuple[PPoly, ...]

    @property
    def ends(self) -> Array:
        """When each piece ends [s]."""
        ends: Array = np.cumsum([duration_of(clock) for clock in self.clocks])
        return ends

    @property
    def duration(self) -> float:
        """Duration of the step [s]."""
        return float(self.ends[-1])


@dataclass(frozen=True)
class Trajectory:
    """Configurations on a regular time grid, k in all, of one step or of several.

    Attributes:
        times: Shape (k,) [s].
        step: Index of the step, shape (k,).
        phase: Index into `regrasp.PHASES`, shape (k,).
        joint_positions: Shape (k, N, 6) [rad].
        joint_velocities: Shape (k, N, 6) [rad/s].
        joint_accelerations: Shape (k, N, 6) [rad/s^2].
        base_positions: Shape (k, 3) [m].
        base_quaternions: Shape (k, 4), w, x, y, z.
        base_velocities: Linear in the world and angular in the base's axes, shape (k, 6) [m/s,
            rad/s].
        base_accelerations: Their derivatives, shape (k, 6) [m/s^2, rad/s^2].
        grasps: Point index each limb holds, or `FREE`, shape (k, N).
        points: Ids of all points of the map.
    """

    times: Array
    step: IntArray
    phase: IntArray
    joint_positions: Array
    joint_velocities: Array
    joint_accelerations: Array
    base_positions: Array
    base_quaternions: Array
    base_velocities: Array
    base_accelerations: Array
    grasps: IntArray
    points: tuple[str, ...]

    @property
    def period(self) -> float:
        """Spacing of the time grid [s]."""
        return float(self.times[1] - self.times[0])

    def after(self, other: Trajectory) -> Trajectory:
        """This trajectory behind another that ends where it starts."""
        late = replace(
            self, times=self.times + other.times[-1], step=self.step + other.step[-1] + 1
        )
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(other, name)[:-1], getattr(late, name)])
            for name in _ARRAYS
        }  # fmt: skip
        return replace(self, **joined)

    def at(self, places: IntArray) -> Trajectory:
        """The samples at some places, one period apart."""
        kept: dict[str, Any] = {name: getattr(self, name)[places] for name in _ARRAYS}
        kept["times"] = self.period * np.arange(len(places), dtype=np.float64)
        return replace(self, **kept)

    def every(self, period: float) -> Trajectory:
        """The samples nearest to a coarser grid of about `period` seconds, with the last one."""
        stride = max(round(period / self.period), 1)
        chosen = np.unique(np.append(np.arange(0, len(self.times), stride), len(self.times) - 1))
        kept: dict[str, Any] = {name: getattr(self, name)[chosen] for name in _ARRAYS}
        return replace(self, **kept)

    def save_npz(self, path: str | Path) -> None:
        """Write the arrays as a NumPy archive, whole or not at all.

        Raises:
            FileError: If the file cannot be written.
        """
        stream = io.BytesIO()
        np.savez_compressed(
            stream, points=np.array(self.points), **{name: getattr(self, name) for name in _ARRAYS}
        )
        write_whole(path, stream.getvalue())

    @classmethod
    def load_npz(cls, path: str | Path) -> Trajectory:
        """Read what `save_npz` wrote.

        Raises:
            PlanError: If the file cannot be read or is not a trajectory.
        """
        try:
            with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as data:
                arrays = {name: data[name] for name in (*_ARRAYS, "points")}
            return cls(**_checked(arrays))
        except Exception as error:  # NumPy, zipfile and zlib raise many kinds
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise PlanError(f"cannot read trajectory {str(path)!r}: {one_line(reason)}") from None

    def save_csv(self, path: str | Path) -> None:
        """Write one line a sample.

        Its columns are time, step, phase, base pose, joint positions and velocities, and the point
        that each limb grasps.

        Raises:
            FileError: If the file cannot be written.
        """
        limbs = self.grasps.shape[1]
        joints = [f"limb{i}_joint{k}" for i in range(limbs) for k in range(1, 7)]
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(
            [
                "time_s",
                "step",
                "phase",
                "base_x_m",
                "base_y_m",
                "base_z_m",
                "base_qw",
                "base_qx",
                "base_qy",
                "base_qz",
            ]
            + [f"{name}_rad" for name in joints]
            + [f"{name}_rad_s" for name in joints]
            + [f"limb{i}_grasp" for i in range(limbs)]
        )
        numbers = np.column_stack(
            [
                self.base_positions, self.base_quaternions,
                self.joint_positions.reshape(len(self.times), -1),
                self.joint_velocities.reshape(len(self.times), -1),
            ]
        )  # fmt: skip
        for k, row in enumerate(numbers):
            held = ["" if point == FREE else self.points[point] for point in self.grasps[k]]
            head = [f"{self.times[k]:.6f}", int(self.step[k]), PHASES[self.phase[k]]]
            writer.writerow([*head, *(f"{value:.9g}" for value in row), *held])
        write_whole(path, stream.getvalue())


_ARRAYS = tuple(field.name for field in fields(Trajectory) if field.name != "points")


def _checked(arrays: dict[str, Any]) -> dict[str, Any]:
    """The arrays of a file of one shape of k samples and N limbs, and the ids as a tuple."""
    points = Listed(NAME, 1, MOST_POINTS).read(arrays.pop("points"), Place("points", PlanError))
    shape = arrays["joint_positions"].shape
    k, limbs = (shape[0], shape[1]) if len(shape) == 3 else (0, 0)
    kinds = {
        "times": Numbers((k,), 0.0, unit="s"),
        "step": Numbers((k,), 0.0),
        "phase": Numbers((k,), 0.0, len(PHASES) - 1.0),
        "joint_positions": Numbers((k, limbs, 6)),
        "joint_velocities": Numbers((k, limbs, 6)),
        "joint_accelerations": Numbers((k, limbs, 6)),
        "base_positions": Numbers((k, 3), most=LONGEST, unit="m"),
        "base_quaternions": Numbers((k, 4), -1.001, 1.001),
        "base_velocities": Numbers((k, 6)),
        "base_accelerations": Numbers((k, 6)),
        "grasps": Numbers((k, limbs), float(FREE), len(points) - 1.0),
    }
    if k < 2:
        raise PlanError("it must hold joint_positions of shape (k, N, 6), k two or more")
    found: dict[str, Any] = {
        name: kind.read(arrays[name], Place(name, PlanError)).astype(arrays[name].dtype)
        for name, kind in kinds.items()
    }
    return found | {"points": points}


def trajectory(timed: TimedPath, period: float = 0.002) -> Trajectory:
    """The trajectory of one step.

    Args:
        timed: The step with its clocks.
        period: Spacing of the time grid [s]. The step takes a whole number of periods, for which
            it is slowed down by less than one.

    Raises:
        PlanError: If a limb that holds cannot follow the base, or a joint would leave its limits.
        SettingError: If the period does not fit the step.
    """
    path, duration = timed.path, timed.duration
    if not (np.isfinite(period) and 0.0 < period < duration):
        raise SettingError(f"period is {period!r}; it must be above 0 and below {duration:g} [s]")
    if duration / period > MOST_SAMPLES:
        raise SettingError(
            f"period is {period!r}: a step of {duration:g} s has more than {MOST_SAMPLES} "
            f"samples; take at least {duration / MOST_SAMPLES:g} s"
        )
    step, graph = path.regrasp, path.graph
    count = int(np.ceil(duration / period - 1e-9)) + 1
    times: Array = np.arange(count, dtype=np.float64) * period
    slower = times[-1] / duration
    ends = timed.ends
    part = np.minimum(np.searchsorted(ends, times / slower, side="left"), len(ends) - 1)
    starts = np.concatenate([[0.0], ends[:-1]])
    u, moving = np.zeros(count), np.empty((count, 6))
    speeds, accelerations = np.empty((2, count, 6 + 6 * graph.limbs))
    last = len(ends) - 1
    for k, (piece, clock) in enumerate(zip(timed.pieces, timed.clocks, strict=True)):
        here = part == k
        since = np.clip(times[here] / slower - starts[k], 0.0, clock.x[-1])
        share = np.clip(clock(since), 0.0, 1.0)
        if k == 0:
            moving[here] = path.departure(share)
        elif k == last:
            moving[here], u[here] = path.approach(share), 1.0
        else:
            u[here], moving[here] = path.swing(k - 1, share)
        rate, change = clock(since, 1) / slower, clock(since, 2) / slower**2
        first, second = piece.curve(share, 1), piece.curve(share, 2)
        speeds[here] = rate[:, None] * first
        accelerations[here] = change[:, None] * first + rate[:, None] ** 2 * second
    positions, rotations = path.base(u)
    joints = path.supports(u)
    joints[:, step.limb] = moving
    _check_limits(graph.robot.limb.limits, joints, times)
    grasps = np.tile(np.array(step.before), (count, 1))
    grasps[:, step.limb] = FREE
    grasps[0, step.limb], grasps[-1, step.limb] = step.before[step.limb], step.to_point
    phases = np.array([piece.phase for piece in timed.pieces])
    return Trajectory(
        times=times,
        step=np.zeros(count, dtype=np.int64),
        phase=phases[part],
        joint_positions=joints,
        joint_velocities=speeds[:, 6:].reshape(joints.shape),
        joint_accelerations=accelerations[:, 6:].reshape(joints.shape),
        base_positions=positions,
        base_quaternions=_quaternions(rotations),
        base_velocities=speeds[:, :6],
        base_accelerations=accelerations[:, :6],
        grasps=grasps,
        points=tuple(graph.grasp_map.ids),
    )


def _check_limits(limits: Array, joints: Array, times: Array) -> None:
    excess = np.maximum(limits[:, 0] - joints, joints - limits[:, 1])
    if excess.max() > LIMIT_TOLERANCE:
        k, limb, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
        raise PlanError(
            f"joint {joint + 1} of limb {limb} would be {excess.max():.4f} rad outside its limits "
            f"{times[k]:.2f} s into the step"
        )


def _quaternions(rotations: Array) -> Array:
    """Quaternions w, x, y, z without jumps of sign, the first with w >= 0."""
    quaternions: Array = Rotation.from_matrix(rotations).as_quat(scalar_first=True)
    same = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]) >= 0.0
    signs = np.cumprod(np.concatenate([[quaternions[0, 0] >= 0.0], same]) * 2.0 - 1.0)
    return quaternions * signs[:, None]
