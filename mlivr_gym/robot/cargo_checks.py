"""Whether the limbs of a robot can move beside its cargo."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.derived import DerivedFigures
from mlivr_gym.robot.link_frames import turn_about_z


def check_cargo(robot: DerivedFigures) -> None:
    """Refuse cargo, or a locked limb, that overlaps bases of limbs or what their shoulders sweep.

    No check of a posture compares these.
    """
    if robot.cargo is None:
        return
    frame, half = robot.cargo_frame, 0.5 * robot.cargo.edges
    where = (
        f"cargo of {' by '.join(f'{edge:g}' for edge in robot.cargo.edges)} m with its centre at "
        f"{frame[:3, 3].tolist()}"
    )
    held = [
        (_samples(ends), radius)
        for link, ends, radius in robot.cargo.limb_capsules
        if LINKS.index(link) >= LINKS.index("upper_arm")
    ]
    for i in range(robot.limbs):
        shapes = {"base": _fixed_shapes(robot, i), "shoulder": _swept_shoulder(robot, i)}
        for link, capsules in shapes.items():
            for axis, radius in capsules:
                samples = _samples(axis)
                local = (samples - frame[:3, 3]) @ frame[:3, :3]
                away = np.linalg.norm(np.maximum(np.abs(local) - half, 0.0), axis=1)
                inside = {where: radius - float(away.min())}
                for other, around in held:
                    gap = np.linalg.norm(samples[:, None] - other, axis=2).min()
                    inside["the locked limb"] = radius + around - float(gap)
                    if inside["the locked limb"] > 0.0:
                        break
                for name, depth in inside.items():
                    if depth > 0.0:
                        raise RobotError(
                            f"{name} overlaps the {link} of limb {i} by {depth:.3g} m, so that no "
                            "posture can hold it; make the cargo smaller, or move it"
                        )


def _samples(axis: Array) -> Array:
    """Return nine points of an axis (2, 3), shape (9, 3)."""
    points: Array = axis[0] + np.linspace(0.0, 1.0, 9)[:, None] * (axis[1] - axis[0])
    return points


def _swept_shoulder(robot: DerivedFigures, limb: int) -> list[tuple[Array, float]]:
    """Return axes and radii of a shoulder's capsules at angles of joint 1, in the body frame."""
    first, swept = robot.every_limb[limb].steps[0], []
    for angle in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
        frame = first @ turn_about_z(angle)
        for shape in robot.mounted[limb].capsules or ():
            if shape.link == "shoulder":
                axis = np.array([shape.start, shape.end]) @ frame[:3, :3].T + frame[:3, 3]
                axis = robot.mount_positions[limb] + axis @ robot.mount_rotations[limb].T
                swept.append((axis, shape.radius))
    return swept


def _fixed_shapes(robot: DerivedFigures, limb: int) -> list[tuple[Array, float]]:
    """Return axes and radii of the capsules of a limb that are fixed to the body."""
    turn, position = robot.mount_rotations[limb], robot.mount_positions[limb]
    return [
        (position + np.array([shape.start, shape.end]) @ turn.T, shape.radius)
        for shape in robot.mounted[limb].capsules or ()
        if shape.link == "base"
    ]
