"""Bounds of how far the shapes of a limb move (compiled); the reasoning is in `swept_swing`."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.link_capsules import seen_from
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.base_path import STRAIGHT, angle_about, position_on_path, turn


@kernel
def joint_motion(plus: Array, minus: Array, lengths: Array, shift: Array, spin: Array) -> None:
    """Bounds of the motion of anchors and links, seen from each of the links 0 to 4.

    Args:
        plus: Changes of the six joints from the middle towards one end [rad], shape (6,).
        minus: Changes towards the other, shape (6,); the opposite on a line in joint space.
        lengths: d1, a2, a3, d4, d5, d6 [m].
        shift: Shape (5, 4), filled with how far the anchors move, seen from link `row` [m].
        spin: Shape (5, 7), filled with how far the links after that one turn [rad].
    """
    arm = np.sqrt(lengths[3] ** 2 + lengths[4] ** 2)
    for row in range(5):
        first = _largest(plus[0], minus[0]) if row == 0 else 0.0
        forth = back = 0.0
        for link in range(7):
            spin[row, link] = 0.0
        spin[row, 1] = first
        for link in range(max(row + 1, 2), 5):
            forth += plus[link - 1]
            back += minus[link - 1]
            spin[row, link] = np.sqrt(first**2 + _largest(forth, back) ** 2)
        spin[row, 5] = spin[row, 6] = spin[row, 4] + _largest(plus[4], minus[4])
        shift[row, 0] = 0.0
        shift[row, 1] = abs(lengths[1]) * spin[row, 2]
        shift[row, 2] = shift[row, 1] + abs(lengths[2]) * spin[row, 3]
        shift[row, 3] = shift[row, 2] + arm * spin[row, 4]


@kernel
def _largest(plus: float, minus: float) -> float:
    """Bound of a change given at both ends: the larger of the two plus the second difference."""
    return max(abs(plus), abs(minus)) + abs(plus + minus)


@kernel
def capsule_motion(
    shapes: tuple[Any, ...], shift: Array, spin: Array, share: float, motion: Array
) -> None:
    """How far each capsule end moves at most over a share of a motion, seen from the limb's base.

    Args:
        shapes: `LimbShapes.arrays`.
        shift: See `joint_motion`.
        spin: See `joint_motion`.
        share: Share of the motion.
        motion: Filled, shape (c, 2) [m].
    """
    for c in range(motion.shape[0]):
        for e in range(2):
            motion[c, e] = share * seen_from(0, c, e, shapes, shift, spin)


@kernel
def moved_by_base(ends: Array, motion: Array, travel: float, swing: float, out: Array) -> None:
    """How far each capsule end moves in the world at most, on a base that moves.

    Args:
        ends: Capsule ends in the body frame [m], shape (c, 2, 3).
        motion: How far they move in the body frame [m], shape (c, 2).
        travel: How far the base travels [m].
        swing: How far it turns [rad].
        out: Filled, shape (c, 2) [m].
    """
    for c in range(motion.shape[0]):
        for e in range(2):
            rho = np.sqrt(ends[c, e, 0] ** 2 + ends[c, e, 1] ** 2 + ends[c, e, 2] ** 2)
            out[c, e] = motion[c, e] + travel + swing * (rho + motion[c, e])


@kernel
def seen_from_grasp(
    plus: Array, minus: Array, lengths: Array, shapes: tuple[Any, ...], out: Array
) -> None:
    """Lower bounds of motion to those that follow a limb that holds from its grasp.

    Args:
        plus: See `joint_motion`.
        minus: See `joint_motion`.
        lengths: d1, a2, a3, d4, d5, d6 [m].
        shapes: `LimbShapes.arrays`.
        out: How far each capsule end moves in the world at most, shape (c, 2) [m], lowered.
    """
    wrist_2 = _largest(plus[5], minus[5])
    wrist_1 = wrist_2 + _largest(plus[4], minus[4])
    fore = wrist_1 + _largest(plus[3], minus[3])
    upper = wrist_1 + _largest(plus[3] + plus[2], minus[3] + minus[2])
    end = np.hypot(lengths[3], lengths[4]) * wrist_1
    elbow = end + abs(lengths[2]) * fore
    link, anchor, arm = shapes[0], shapes[4], shapes[5]
    for c in range(len(link)):
        for e in range(2):
            start, turned = elbow, upper
            if link[c] == 6:
                start, turned = 0.0, 0.0
            elif link[c] == 5:
                start, turned = 0.0, wrist_2
            elif link[c] == 4:
                start, turned = end if anchor[c, e] == 2 else 0.0, wrist_1
            elif link[c] == 3:
                start, turned = end if anchor[c, e] == 2 else elbow, fore
            elif link[c] == 1 or anchor[c, e] == 0:
                continue
            out[c, e] = min(out[c, e], start + arm[c, e] * turned)


@kernel
def path_speed(path: tuple[Any, ...]) -> float:
    """Largest speed of the base origin on a path of unit duration [m].

    The path is given as (t0, r0, t1, r1, kind, pivot).
    """
    t0, _, t1, _, kind, pivot = path
    rho0 = rho1 = shift = 0.0
    for k in range(3):
        rho0 += (t0[k] - pivot[k]) ** 2
        rho1 += (t1[k] - pivot[k]) ** 2
        shift += (t1[k] - t0[k]) ** 2
    speed: float = np.sqrt(shift)
    if kind != STRAIGHT:
        rho0, rho1 = np.sqrt(rho0), np.sqrt(rho1)
        speed = np.hypot(rho1 - rho0, max(rho0, rho1) * angle_about(t0, t1, pivot))
    return speed


@kernel
def pose_on_path(
    path: tuple[Any, ...], axis: Array, omega: float, s: float, position: Array, rotation: Array
) -> None:
    """Base pose in the world at `s` on a path.

    Args:
        path: Base path (t0, r0, t1, r1, kind, pivot).
        axis: Axis of its rotation in the body frame at the start, shape (3,).
        omega: Angle of its rotation [rad].
        s: Path parameter from 0 to 1.
        position: Filled, shape (3,) [m].
        rotation: Filled, shape (3, 3).
    """
    t0, r0, t1, _, kind, pivot = path
    position_on_path(t0, t1, kind, pivot, s, position)
    c, sine = np.cos(s * omega), np.sin(s * omega)
    for row in range(3):
        # A row of R exp(w) is the row of R turned back.
        x, y, z = turn(axis, c, -sine, r0[row, 0], r0[row, 1], r0[row, 2])
        rotation[row, 0], rotation[row, 1], rotation[row, 2] = x, y, z
