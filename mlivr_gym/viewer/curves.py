"""Plots of manipulability, torques and forces below the scrubber, over the time of the frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import BASE_COLOUR
from mlivr_gym.robot.link_frames import link_frames
from mlivr_gym.robot.specification import LIMB_COLOURS, RobotSpec
from mlivr_gym.simulation.recording import Recording
from mlivr_gym.viewer.frames import AT_REST, Frames

THRESHOLD_COLOUR, FLOOR_COLOUR, TORQUE_COLOUR = "#495057", "#e8a0a0", "#9c36b5"
"""Colours of thresholds, of the path floor and of torques."""


MAX_TIMES = 240
"""Maximum number of times of a plot that is shown."""


class Plot(NamedTuple):
    """Curves over a common time axis."""

    title: str
    """Title with the unit."""
    times: Array
    """Times, shape (k,) [s]."""
    curves: tuple[tuple[str, str, Array], ...]
    """Label, colour and values of each curve, shape (k,); missing values are NaN."""

    @property
    def highest(self) -> float:
        """Upper end of the axis of values, slightly above the largest value."""
        return 1.05 * max(float(np.nanmax(curve)) for _, _, curve in self.curves)


def limb_manipulabilities(robot: RobotSpec, joints: Array) -> Array:
    """Compute the limb manipulability w_m at joint angles (k, N, 6) [rad], shape (k, N).

    The Jacobian is square, so that `w_m = |det J| / l_c^3`, at whatever point twists are taken.
    """
    out = np.empty(joints.shape[:2])
    for i, limb in enumerate(robot.every_limb):
        frames = link_frames(limb, joints[:, i])[:, 1:]
        origins, axes = frames[..., :3, 3], frames[..., :3, 2]
        twists = np.concatenate([np.cross(origins, axes), axes], axis=2)
        out[:, i] = np.abs(np.linalg.det(twists)) / robot.characteristic_length**3
    return out


def margins(frames: Frames, plan: Plan) -> Plot:
    """Plot manipulability divided by its threshold.

    The curve of a limb has values while the limb holds; the curve of the base joins its values in
    stances. A plan without thresholds has no curves.
    """
    title, settings = "manipulability / threshold", plan.world.settings
    limb_threshold, base_threshold = settings.thresholds(plan.world.robot.limbs)
    if limb_threshold <= 0.0 or base_threshold <= 0.0 or len(frames) < 2:
        return Plot(title, frames.times, ())
    robot = plan.world.robot
    limb = limb_manipulabilities(robot, frames.joint_positions) / limb_threshold
    swing_limb = np.array([step.limb for step in plan.steps] or [0])[
        np.minimum(frames.step, len(plan.steps) - 1)
    ]
    in_step = frames.phase < AT_REST
    for i in range(robot.limbs):
        limb[in_step & (swing_limb == i), i] = np.nan
    base = np.full(len(frames), np.nan)
    first = np.searchsorted(frames.times, frames.starts())
    base[first] = plan.motion.w_b[: len(first)] / base_threshold
    base = np.interp(frames.times, frames.times[first], base[first])
    curves = [(f"limb {i}", LIMB_COLOURS[i], limb[:, i]) for i in range(robot.limbs)]
    curves.append(("base, in stances", BASE_COLOUR, base))
    curves.append(("threshold", THRESHOLD_COLOUR, np.ones(len(frames))))
    floor = np.full(len(frames), settings.path_floor / limb_threshold)
    curves.append(("path floor", FLOOR_COLOUR, floor))
    return Plot(title, frames.times, tuple(curves))


def recorded(recording: Recording) -> dict[str, Plot]:
    """Plot joint torques, root mean square and maximum, and grasp forces of an execution."""
    times = recording.times - recording.times[0]
    largest = np.abs(recording.joint_torques).max(axis=(1, 2))
    forces = np.linalg.norm(recording.grasp_forces, axis=2).T
    torques = ("RMS", TORQUE_COLOUR, recording.torque_rms), ("largest", THRESHOLD_COLOUR, largest)
    limbs = tuple((f"limb {i}", LIMB_COLOURS[i], force) for i, force in enumerate(forces))
    return {
        "torques": Plot("joint torque [N m]", times, torques),
        "forces": Plot("grasp force [N]", times, limbs),
    }


def with_cursor(plot: Plot, now: float) -> tuple[Array, list[Array]]:
    """Return times and curves of a plot, at most `MAX_TIMES`, with a line at a time [s] as last.

    The vertical line is a curve with two values at this time, at which all curves are interpolated.
    """
    count = len(plot.times)
    chosen = np.linspace(0, count - 1, min(count, MAX_TIMES)).round().astype(np.int64)
    times, values = plot.times[chosen], np.stack([curve[chosen] for _, _, curve in plot.curves])
    at = int(np.searchsorted(times, now))
    between = [np.interp(now, times, curve) for curve in values]
    here = np.repeat(np.array(between)[:, None], 2, axis=1)
    line = np.full(len(times) + 2, np.nan)
    line[at : at + 2] = 0.0, plot.highest
    times = np.insert(times, at, [now, now])
    return times, [*np.insert(values, [at, at], here, axis=1), line]
