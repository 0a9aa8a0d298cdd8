"""Whether the limbs of a robot can move where they are mounted."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.robot.derived import DerivedFigures
from mlivr_gym.robot.link_frames import turn_about_z


def check_build(robot: DerivedFigures) -> None:
    """Refuse a body on which the limbs cannot move."""
    half = 0.5 * robot.body_edges
    limbs, positions, turns = robot.every_limb, robot.mount_positions, robot.mount_rotations
    shoulders = [
        p + limb.shoulder_height * turn[:, 2]
        for limb, p, turn in zip(limbs, positions, turns, strict=True)
    ]
    for i, shoulder in enumerate(shoulders):
        inside = float((half - np.abs(shoulder)).min())
        if inside > 0.0:
            raise RobotError(
                f"the shoulder of limb {i} lies {inside:.3g} m inside the body, a box of "
                f"{' by '.join(f'{edge:g}' for edge in robot.body_edges)} m; mount it farther out, "
                "or give a smaller body_size"
            )
    for i in range(robot.limbs):
        for j in range(i):
            _check_pair(robot, (i, j), (shoulders[i], shoulders[j]))


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


def _check_pair(
    robot: DerivedFigures, pair: tuple[int, int], shoulders: tuple[Array, Array]
) -> None:
    """Refuse two limbs whose bases or shoulders overlap, or that never reach points of a stance."""
    i, j = pair
    limbs, apart = robot.every_limb, float(np.linalg.norm(shoulders[0] - shoulders[1]))
    reach = limbs[i].reach + limbs[j].reach + 2.0 * robot.tool_length
    if apart - reach > robot.span:
        raise RobotError(
            f"limbs {j} and {i} are mounted {apart:.3g} m apart and reach {reach:.3g} m together; "
            f"the points of a stance lie at most {robot.span:.3g} m apart (span)"
        )
    radius = [_shoulder_radius(robot, limb) for limb in (i, j)]
    gaps = [apart - sum(radius)] if min(radius) > 0.0 else []
    for shoulder, ball, other in zip(shoulders, radius, (j, i), strict=True):
        for axis, around in _fixed_shapes(robot, other) if ball > 0.0 else ():
            gaps.append(_point_distance(shoulder, axis) - around - ball)
    if min(gaps, default=0.0) < 0.0:
        raise RobotError(
            f"limbs {j} and {i} meet at rest: where they are mounted their shoulders overlap by "
            f"{-min(gaps):.3g} m; mount them farther apart, with a larger mount_radius or fewer "
            "limbs"
        )


def _fixed_shapes(robot: DerivedFigures, limb: int) -> list[tuple[Array, float]]:
    """Return axes and radii of the capsules of a limb that are fixed to the body."""
    turn, position = robot.mount_rotations[limb], robot.mount_positions[limb]
    return [
        (position + np.array([shape.start, shape.end]) @ turn.T, shape.radius)
        for shape in robot.mounted[limb].capsules or ()
        if shape.link == "base"
    ]


def _shoulder_radius(robot: DerivedFigures, limb: int) -> float:
    """Return the radius of a ball about the shoulder that its capsules fill, 0 if none does [m]."""
    return max(
        (
            shape.radius - _point_distance(np.zeros(3), np.array([shape.start, shape.end]))
            for shape in robot.mounted[limb].capsules or ()
            if shape.link == "shoulder"
        ),
        default=0.0,
    )


def _point_distance(point: Array, segment: Array) -> float:
    along = segment[1] - segment[0]
    square = float(along @ along)
    share = float(np.clip((point - segment[0]) @ along / square, 0.0, 1.0)) if square else 0.0
    return float(np.linalg.norm(point - segment[0] - share * along))
