"""Trajectories: the joint path of a step with a time scaling, sampled on a regular time grid.

Each path segment runs from rest to rest by its time scaling, smoothly through its knots, see
`joint_path`. The base follows from the joint angles of the leader.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import scipy

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import PlanError, SettingError
from mlivr_gym.kinematics.chain import LIMIT_TOLERANCE
from mlivr_gym.motion.joint_path import PHASES, JointPath, quaternions
from mlivr_gym.motion.time_scaling import duration_of
from mlivr_gym.motion.timed_configurations import TimedConfigurations
from mlivr_gym.schema import Tuples
from mlivr_gym.world.grasp_map import GraspMap

FREE = -1
"""Point index of a limb that holds no point."""

MAX_SAMPLES = 1_000_000
"""Upper bound of the samples of a step: half an hour at 2 ms, about a gigabyte."""


class TimedPath(NamedTuple):
    """A step with a time scaling for each of its path segments."""

    path: JointPath
    """The joint path of the step."""
    time_scalings: tuple[scipy.interpolate.PPoly, ...]
    """Time scaling of each segment."""

    @property
    def ends(self) -> Array:
        """Time at which each segment ends [s]."""
        ends: Array = np.cumsum([duration_of(scaling) for scaling in self.time_scalings])
        return ends

    @property
    def duration(self) -> float:
        """Duration of the step [s]."""
        return float(self.ends[-1])


@dataclass(frozen=True)
class Trajectory(TimedConfigurations):
    """Configurations, velocities and accelerations at k regular times, for one step or several."""

    joint_velocities: Array
    """Joint velocities, shape (k, N, 6) [rad/s]."""
    joint_accelerations: Array
    """Joint accelerations, shape (k, N, 6) [rad/s^2]."""
    base_velocities: Array
    """Linear velocity of the base in the world frame and angular velocity in the body frame, shape
    (k, 6) [m/s, rad/s]."""
    base_accelerations: Array
    """Derivatives of the base velocities, shape (k, 6) [m/s^2, rad/s^2]."""
    grasps: IntArray
    """Point index that each limb holds, or `FREE`, shape (k, N)."""
    point_ids: tuple[str, ...]
    """Ids of all points of the map."""
    joint_names: tuple[str, ...]
    """Names of all joints by limb, those of the file the robot is read from, N times six."""

    @property
    def period(self) -> float:
        """Spacing of the time grid [s]."""
        return float(self.times[1] - self.times[0])

    def after(self, other: Trajectory) -> Trajectory:
        """Return this trajectory appended to another one that ends where it starts."""
        late = replace(
            self, times=self.times + other.times[-1], step=self.step + other.step[-1] + 1
        )
        return Trajectory.join([other.part(slice(-1)), late])

    def at(self, indices: IntArray) -> Trajectory:
        """Return the samples at some indices, with new times one period apart from 0."""
        times = self.period * np.arange(len(indices), dtype=np.float64)
        return replace(self.part(indices), times=times)

    def backwards(self, slowness: int) -> Trajectory:
        """Return the way back, which takes `slowness` times as long, with the phases exchanged.

        Samples between those of this trajectory are interpolated linearly.
        """
        count = (len(self.times) - 1) * slowness + 1
        rates = np.full(count, -1.0 / slowness)
        return self._resampled(np.arange(count)[::-1] / slowness, rates, 0)

    def turned_back(self, first: int, slowness: int, duration: float) -> Trajectory | None:
        """Return the motion that follows this trajectory to a sample, turns and goes back.

        From the index `first` of a sample on, the rate at which this trajectory is followed falls
        smoothly from 1 to that of `backwards` within `duration` [s]. Samples are interpolated, and
        from there on phases are exchanged, as there. The way back takes `slowness` times as long as
        that to the sample. The result is None if this trajectory would end, or be back, before the
        motion has turned.
        """
        n, change = max(round(duration / self.period), 1), 1.0 + 1.0 / slowness
        t = np.arange(n + 1) / n
        turning = first + n * (t - change * (t**3 - 0.5 * t**4))
        if turning.max() >= len(self.times) - 1 or turning[-1] <= 0.0:
            return None
        returning = turning[-1] - np.arange(1, int(np.ceil(turning[-1] * slowness)) + 1) / slowness
        samples = np.concatenate([np.arange(first), turning, np.maximum(returning, 0.0)])
        rates = np.full(len(samples), -1.0 / slowness)
        rates[:first] = 1.0
        rates[first : first + n + 1] = 1.0 - change * (3.0 * t**2 - 2.0 * t**3)
        return self._resampled(samples, rates, first)

    def _resampled(self, samples: Array, rates: Array, first: int) -> Trajectory:
        """Return the motion through given samples, in fractions, at given rates; see `backwards`.

        A rate is the derivative of the followed time by the time. By the chain rule velocities are
        multiplied by it, and accelerations by its square, plus the velocity times its derivative.
        Phases are exchanged from the index `first` of the new samples on.
        """
        before = np.minimum(samples.astype(np.int64), len(self.times) - 2)
        fraction = samples - before
        kept = self.at(np.where(fraction < 0.5, before, before + 1))
        between: dict[str, Any] = {}
        for name in MOTION:
            values = getattr(self, name)
            weight = fraction.reshape(-1, *[1] * (values.ndim - 1))
            between[name] = (1.0 - weight) * values[before] + weight * values[before + 1]
        changes = np.gradient(rates, self.period)
        for velocity, acceleration in VELOCITIES.items():
            shape = (-1, *[1] * (between[velocity].ndim - 1))
            rate, change = rates.reshape(shape), changes.reshape(shape)
            between[acceleration] = rate**2 * between[acceleration] + change * between[velocity]
            between[velocity] = rate * between[velocity]
        phase = kept.phase.copy()
        phase[first:] = len(PHASES) - 1 - phase[first:]
        return replace(kept, phase=phase, **between)

    @checked({"period": Tuples((), 1e-12, 1e9, "s")})
    def every(self, period: float) -> Trajectory:
        """Return every n-th sample, about `period` seconds apart, and the last one."""
        stride = max(round(period / self.period), 1)
        chosen = np.unique(np.append(np.arange(0, len(self.times), stride), len(self.times) - 1))
        return self.part(chosen)


VELOCITIES = {"joint_velocities": "joint_accelerations", "base_velocities": "base_accelerations"}
"""Fields of velocities, and those of their derivatives."""

MOTION = (
    "joint_positions",
    "base_positions",
    "base_quaternions",
    *VELOCITIES,
    *VELOCITIES.values(),
)
"""Fields that change with the time of a trajectory."""


def trajectory(
    grasp_map: GraspMap, stances: Sequence[Sequence[str]], timed: TimedPath, period: float = 0.002
) -> Trajectory:
    """Compute the trajectory of one step between two stances, given by the ids of their points.

    By the chain rule the velocity is `q' sigma_dot` and the acceleration `q' sigma_ddot + q''
    sigma_dot^2`, with the derivatives q', q'' of the path segment and those of its time scaling
    sigma(t). The step is slowed down by less than one `period`, the spacing of the time grid [s],
    so that it takes a whole number of periods.

    Raises a `PlanError` if a joint would leave its limits, and a `SettingError` if the period is
    not positive, exceeds the step, or gives too many samples.
    """
    path, duration = timed.path, timed.duration
    if not (np.isfinite(period) and 0.0 < period < duration):
        raise SettingError(f"period is {period!r}; it must be above 0 and below {duration:g} [s]")
    if duration / period > MAX_SAMPLES:
        raise SettingError(
            f"period is {period!r}: a step of {duration:g} s has more than {MAX_SAMPLES} "
            f"samples; it must be at least {duration / MAX_SAMPLES:g} s"
        )
    count = int(np.ceil(duration / period - 1e-9)) + 1
    times: Array = np.arange(count, dtype=np.float64) * period
    slower = times[-1] / duration
    ends = timed.ends
    part = np.minimum(np.searchsorted(ends, times / slower, side="left"), len(ends) - 1)
    starts = np.concatenate([[0.0], ends[:-1]])
    joints = np.empty((count, *path.knots.shape[1:]))
    speeds, accelerations = np.empty((2, count, 6 + joints[0].size))
    for k, (segment, scaling) in enumerate(zip(path.segments, timed.time_scalings, strict=True)):
        on_part = part == k
        since = np.clip(times[on_part] / slower - starts[k], 0.0, scaling.x[-1])
        sigma = np.clip(scaling(since), 0.0, 1.0)
        joints[on_part] = segment.joints_at(sigma)
        rate, change = scaling(since, 1) / slower, scaling(since, 2) / slower**2
        first, second = segment.curve(sigma, 1), segment.curve(sigma, 2)
        speeds[on_part] = rate[:, None] * first
        accelerations[on_part] = change[:, None] * first + rate[:, None] ** 2 * second
    positions, rotations = path.base(joints)
    _check_limits(path.robot.joint_limits, joints, times)
    before, after = ([grasp_map.index(point) for point in stance] for stance in stances)
    grasps = np.tile(np.array(before), (count, 1))
    grasps[1:-1, path.limb], grasps[-1, path.limb] = FREE, after[path.limb]
    return Trajectory(
        times=times,
        step=np.zeros(count, dtype=np.int64),
        phase=np.array([segment.phase for segment in path.segments])[part],
        joint_positions=joints,
        joint_velocities=speeds[:, 6:].reshape(joints.shape),
        joint_accelerations=accelerations[:, 6:].reshape(joints.shape),
        base_positions=positions,
        base_quaternions=quaternions(rotations),
        base_velocities=speeds[:, :6],
        base_accelerations=accelerations[:, :6],
        grasps=grasps,
        point_ids=tuple(grasp_map.ids),
        joint_names=tuple(chain(*path.robot.named_joints)),
    )


def _check_limits(limits: Array, joints: Array, times: Array) -> None:
    """Check that all joint angles are inside the joint limits."""
    excess = np.maximum(limits[..., 0] - joints, joints - limits[..., 1])
    if excess.max() > LIMIT_TOLERANCE:
        k, limb, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
        raise PlanError(
            f"joint {joint + 1} of limb {limb} would be {excess.max():.4f} rad outside its limits "
            f"{times[k]:.2f} s into the step"
        )
