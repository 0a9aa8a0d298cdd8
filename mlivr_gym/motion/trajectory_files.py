"""Files of trajectories: NumPy archives, CSV tables and ROS 2 messages.

Joints have the names, signs and zeros of the file the robot is read from, those of another robot
are `limb0/joint1` and so on. All numbers have all their digits.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.files import write_whole
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.joint_path import PHASES
from mlivr_gym.motion.trajectory import FREE, Trajectory

BASE = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Components of the base pose: position, and quaternion w, x, y, z."""
RATES = ("vx", "vy", "vz", "wx", "wy", "wz")
"""Components of the base velocity: linear in the world frame, angular in the body frame."""


@checked(ARGUMENTS)
def save_npz(trajectory: Trajectory, path: str | Path) -> None:
    """Write a trajectory as a NumPy archive; the file is replaced as a whole or not at all.

    The archive has the fields of `Trajectory`, with `point_ids` as `points`, and the names of the
    phases, `phases`. Raises a `FileError` if the file cannot be written.
    """
    stream = io.BytesIO()
    np.savez_compressed(
        stream,
        points=np.array(trajectory.point_ids),
        joint_names=np.array(trajectory.joint_names),
        phases=np.array(PHASES),
        **trajectory.arrays(),  # type: ignore[arg-type]
    )
    write_whole(path, stream.getvalue())


@checked(ARGUMENTS)
def save_csv(trajectory: Trajectory, path: str | Path) -> None:
    """Write a trajectory as CSV, one line for each sample, with units in the column names.

    The columns are time, step, phase, base pose and velocity; position, velocity and acceleration
    of each joint; the point that each limb holds; and `event`, the releases and grasps since the
    line before. Raises a `FileError` if the file cannot be written.
    """
    names, count = trajectory.joint_names, len(trajectory.times)
    limbs = trajectory.grasps.shape[1]
    units = {"x": "m", "y": "m", "z": "m"}
    head = ["time_s", "step", "phase"]
    head += [f"base_{name}" + (f"_{units[name]}" if name in units else "") for name in BASE]
    head += [f"base_{name}_{'m' if name[0] == 'v' else 'rad'}_s" for name in RATES]
    for what in ("position_rad", "velocity_rad_s", "acceleration_rad_s2"):
        head += [f"{name}/{what}" for name in names]
    head += [f"limb{i}/grasp" for i in range(limbs)] + ["event"]
    numbers = np.column_stack(
        [
            trajectory.base_positions, trajectory.base_quaternions, trajectory.base_velocities,
            trajectory.joint_positions.reshape(count, -1),
            trajectory.joint_velocities.reshape(count, -1),
            trajectory.joint_accelerations.reshape(count, -1),
        ]
    )  # fmt: skip
    stream, held = io.StringIO(), _held(trajectory)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    for k, row in enumerate(numbers):
        leading = [
            f"{trajectory.times[k]:.6f}",
            int(trajectory.step[k]),
            PHASES[trajectory.phase[k]],
        ]
        event = _event(held[max(k - 1, 0)], held[k])
        writer.writerow([*leading, *row.tolist(), *held[k], event])
    write_whole(path, stream.getvalue())


def message_time(time: float) -> dict[str, int]:
    """Return a time [s] as `builtin_interfaces/msg/Time` or `Duration` of ROS 2."""
    seconds, nanoseconds = divmod(round(1e9 * time), 10**9)
    return {"sec": seconds, "nanosec": nanoseconds}


@checked(ARGUMENTS)
def joint_trajectory_message(trajectory: Trajectory) -> dict[str, Any]:
    """Return a trajectory as plain data with the fields of `trajectory_msgs/msg/JointTrajectory`.

    The message has positions, velocities and accelerations of all joints; it has no field for
    grasps. Its fields are those of https://github.com/ros2/common_interfaces.
    """
    kinds = ("positions", "velocities", "accelerations")
    values = {kind: getattr(trajectory, f"joint_{kind}") for kind in kinds}
    return {
        "header": {"stamp": message_time(0.0), "frame_id": ""},
        "joint_names": list(trajectory.joint_names),
        "points": [
            {kind: values[kind][k].ravel().tolist() for kind in kinds}
            | {"effort": [], "time_from_start": message_time(float(trajectory.times[k]))}
            for k in range(len(trajectory.times))
        ],
    }


@checked(ARGUMENTS)
def save_ros(trajectory: Trajectory, path: str | Path) -> None:
    """Write a trajectory as a ROS 2 message `trajectory_msgs/msg/JointTrajectory` in YAML.

    Grasps, for which the message has no field, are written as comments. Raises a `FileError` if the
    file cannot be written.
    """
    message, held = joint_trajectory_message(trajectory), _held(trajectory)
    lines = [
        "# trajectory_msgs/msg/JointTrajectory",
        "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}",
        "joint_names:",
        *(f"- {name}" for name in message["joint_names"]),
        "points:",
    ]
    for k, point in enumerate(message["points"]):
        event = _event(held[max(k - 1, 0)], held[k])
        if event:
            lines.append(f"# {event}")
        for column, kind in enumerate(("positions", "velocities", "accelerations")):
            numbers = ", ".join(map(repr, point[kind]))
            lines.append(f"{'-' if column == 0 else ' '} {kind}: [{numbers}]")
        lines.append("  effort: []")
        time = point["time_from_start"]
        lines.append(f"  time_from_start: {{sec: {time['sec']}, nanosec: {time['nanosec']}}}")
    write_whole(path, "\n".join(lines) + "\n")


def _held(trajectory: Trajectory) -> list[list[str]]:
    """Return the id of the point that each limb holds at each time, empty for a free limb."""
    return [
        ["" if point == FREE else trajectory.point_ids[point] for point in row]
        for row in trajectory.grasps
    ]


def _event(before: list[str], after: list[str]) -> str:
    """Return the releases and grasps between two samples as text."""
    events = []
    for limb, (was, now) in enumerate(zip(before, after, strict=True)):
        if was != now:
            events += [f"limb{limb} releases {was}"] if was else []
            events += [f"limb{limb} grasps {now}"] if now else []
    return "; ".join(events)
