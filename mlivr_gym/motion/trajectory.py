"""Trajectories: regrasps with a clock.

Departure, each piece of the swing, and approach run from rest to rest on a quintic, so that
velocity and acceleration vanish at every corner of the path that was checked and the path itself is
kept exactly. The swing's time is shared among its pieces such that the largest acceleration of any
joint is about the same in all of them. The base moves along with the swing.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import PlanError, SettingError, one_line
from mlivr_gym.files import write_whole
from mlivr_gym.kinematics.arm import LIMIT_TOLERANCE
from mlivr_gym.motion.regrasp import PHASES, RegraspPath
from mlivr_gym.schema import NAME, Listed, Numbers, Place
from mlivr_gym.values import LONGEST, MOST_POINTS

FREE = -1
"""Grasp state of a limb that holds nothing."""

LONGEST_STEP = 3600.0
"""Largest duration of a step [s]; the paper's is 50 s."""

MOST_SAMPLES = 1_000_000
"""Most samples of a step's trajectory, half an hour at 2 ms; they take about a gigabyte."""

PIECE_SAMPLES = 65
"""Places at which a piece of a swing is looked at to find the joint that travels farthest."""


@dataclass(frozen=True)
class Durations:
    """How long the parts of a step take.

    Attributes:
        departure: Departure along the surface normal [s].
        swing: Swing, with the base moving [s].
        approach: Approach along the surface normal [s].
    """

    departure: float = 10.0
    swing: float = 30.0
    approach: float = 10.0

    def __post_init__(self) -> None:
        """Check that each is above zero, and the whole not too long."""
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0.0):
                raise SettingError(
                    f"duration of the {field.name} is {value!r}; it must be finite and above 0 [s]"
                )
        if self.total > LONGEST_STEP:
            raise SettingError(
                f"duration of a step is {self.total:g} s; it must be at most {LONGEST_STEP:g} s"
            )

    @property
    def total(self) -> float:
        """Duration of a step [s]."""
        return self.departure + self.swing + self.approach

    @classmethod
    def of_step(cls, total: float) -> Durations:
        """A step of `total` seconds, divided as the paper's: a fifth, three fifths, a fifth."""
        return cls(0.2 * total, 0.6 * total, 0.2 * total)


@dataclass(frozen=True)
class Trajectory:
    """Configurations on a regular time grid, k in all, of one step or of several.

    Attributes:
        times: Shape (k,) [s].
        step: Index of the step, shape (k,).
        phase: Index into `regrasp.PHASES`, shape (k,).
        joint_positions: Shape (k, N, 6) [rad].
        joint_velocities: Shape (k, N, 6) [rad/s], from differences on the grid.
        base_positions: Shape (k, 3) [m].
        base_quaternions: Shape (k, 4), w, x, y, z.
        grasps: Point index each limb holds, or `FREE`, shape (k, N).
        points: Ids of all points of the map.
    """

    times: Array
    step: IntArray
    phase: IntArray
    joint_positions: Array
    joint_velocities: Array
    base_positions: Array
    base_quaternions: Array
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
        "base_positions": Numbers((k, 3), most=LONGEST, unit="m"),
        "base_quaternions": Numbers((k, 4), -1.001, 1.001),
        "grasps": Numbers((k, limbs), float(FREE), len(points) - 1.0),
    }
    if k < 2:
        raise PlanError("it must hold joint_positions of shape (k, N, 6), k two or more")
    found: dict[str, Any] = {
        name: kind.read(arrays[name], Place(name, PlanError)).astype(arrays[name].dtype)
        for name, kind in kinds.items()
    }
    return found | {"points": points}


def quintic(s: Array) -> Array:
    """The quintic from 0 to 1 with zero velocity and acceleration at both ends."""
    value: Array = s**3 * (10.0 + s * (-15.0 + 6.0 * s))
    return value


def trajectory(
    path: RegraspPath, durations: Durations | None = None, period: float = 0.002
) -> Trajectory:
    """The trajectory of one regrasp.

    Args:
        path: The regrasp.
        durations: How long its parts take; by default the paper's 10, 30 and 10 s.
        period: Spacing of the time grid [s]; the step takes a whole number of them.

    Raises:
        PlanError: If a limb that holds cannot follow the base, or a joint would leave its limits.
    """
    durations = durations or Durations()
    if not (np.isfinite(period) and 0.0 < period < durations.total):
        raise SettingError(
            f"period is {period!r}; it must be above 0 and below {durations.total:g} [s]"
        )
    if durations.total / period > MOST_SAMPLES:
        raise SettingError(
            f"period is {period!r}: a step of {durations.total:g} s has more than {MOST_SAMPLES} "
            f"samples; take at least {durations.total / MOST_SAMPLES:g} s"
        )
    step, graph = path.regrasp, path.graph
    count = round(durations.total / period) + 1
    times: Array = np.arange(count, dtype=np.float64) * period
    ends = np.cumsum([durations.departure, *(durations.swing * _shares(path)), durations.approach])
    ends *= times[-1] / ends[-1]
    part = np.minimum(np.searchsorted(ends, times, side="left"), len(ends) - 1)
    starts = np.concatenate([[0.0], ends[:-1]])
    share = quintic(np.clip((times - starts[part]) / (ends - starts)[part], 0.0, 1.0))
    u, moving = np.zeros(count), np.empty((count, 6))
    last = len(ends) - 1
    for piece in range(len(ends)):
        here = part == piece
        if piece == 0:
            moving[here] = path.departure(share[here])
        elif piece == last:
            moving[here], u[here] = path.approach(share[here]), 1.0
        else:
            u[here], moving[here] = path.swing(piece - 1, share[here])
    positions, rotations = path.base(u)
    joints = path.supports(u)
    joints[:, step.limb] = moving
    _check_limits(graph.robot.limb.limits, joints, times)
    grasps = np.tile(np.array(step.before), (count, 1))
    grasps[:, step.limb] = FREE
    grasps[0, step.limb], grasps[-1, step.limb] = step.before[step.limb], step.to_point
    return Trajectory(
        times, np.zeros(count, dtype=np.int64), np.clip(part, 0, 1) + (part == last), joints,
        np.gradient(joints, times, axis=0), positions, _quaternions(rotations), grasps,
        tuple(graph.grasp_map.ids),
    )  # fmt: skip


def _shares(path: RegraspPath) -> Array:
    """Share of the swing's time that each of its pieces gets.

    It goes with the square root of travel, since accelerations go with travel over time squared.
    """
    share = np.linspace(0.0, 1.0, PIECE_SAMPLES)
    pieces = [path.swing(piece, share) for piece in range(path.pieces)]
    others = path.supports(np.concatenate([u for u, _ in pieces])).reshape(
        len(pieces), PIECE_SAMPLES, -1
    )
    travel = [
        max(_travel(moving), _travel(held[:, ~np.isnan(held[0])]))
        for (_, moving), held in zip(pieces, others, strict=True)
    ]
    roots: Array = np.sqrt(travel)
    shares: Array = roots / roots.sum()
    return shares


def _travel(joints: Array) -> float:
    """Farthest travel of any joint [rad]."""
    return float(np.abs(np.diff(joints, axis=0)).sum(axis=0).max())


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
