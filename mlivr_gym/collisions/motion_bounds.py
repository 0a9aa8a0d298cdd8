"""Compiled bounds of how far the shapes of a limb move; the reasoning is in `swept_kernels`."""

from __future__ import annotations

import numpy as np

from mlivr_gym.collisions.link_capsules import seen_from
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.kinematics.base_path import STRAIGHT, angle_about, position_on_path, turn


@kernel
def joint_motion(plus, minus, lengths, shift, spin):
    """Bounds of motion between joint angles `plus` and `minus` away from the middle, seen from each of the links 0 to 4.

    Args:
        plus: Changes of the six joints towards one end [rad].
        minus: Changes towards the other; the opposite on a line in joint space.
        lengths: d1, a2, a3, d4, d5, d6 [m].
        shift: Shape (5, 4), filled with how far the anchors move, seen from link `row` [m].
        spin: Shape (5, 7), filled with how far the links beyond it turn [rad].
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
def _largest(plus, minus):
    """Bound of a change whose values at both ends are given: the larger, and the second difference."""
    return max(abs(plus), abs(minus)) + abs(plus + minus)


@kernel
def capsule_motion(shapes, shift, spin, share, motion):
    """How far each capsule end moves at most in the limb frame over a share of a motion, into `motion`, (c, 2) [m]."""
    for c in range(motion.shape[0]):
        for e in range(2):
            motion[c, e] = share * seen_from(0, c, e, shapes, shift, spin)


@kernel
def moved_by_base(ends, motion, travel, swing, out):
    """How far each capsule end moves in the world: `motion` and what the base adds, `travel` [m] and `swing` [rad]."""
    for c in range(motion.shape[0]):
        for e in range(2):
            rho = np.sqrt(ends[c, e, 0] ** 2 + ends[c, e, 1] ** 2 + ends[c, e, 2] ** 2)
            out[c, e] = motion[c, e] + travel + swing * (rho + motion[c, e])


@kernel
def seen_from_grasp(plus, minus, lengths, shapes, out):
    """Lower `out`, shape (c, 2) [m], to how far each capsule end of a holding limb moves, followed from the grasp."""
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
def path_speed(path):
    """Largest speed of the base origin on a path of unit duration [m]."""
    t0, r0, t1, r1, kind, pivot = path
    rho0 = rho1 = shift = 0.0
    for k in range(3):
        rho0 += (t0[k] - pivot[k]) ** 2
        rho1 += (t1[k] - pivot[k]) ** 2
        shift += (t1[k] - t0[k]) ** 2
    if kind == STRAIGHT:
        return np.sqrt(shift)
    rho0, rho1 = np.sqrt(rho0), np.sqrt(rho1)
    return np.hypot(rho1 - rho0, max(rho0, rho1) * angle_about(t0, t1, pivot))


@kernel
def pose_on_path(path, axis, omega, s, position, rotation):
    """Base pose at `s` on a path (t0, r0, t1, r1, kind, pivot) whose rotation turns by `omega` about `axis`."""
    t0, r0, t1, r1, kind, pivot = path
    position_on_path(t0, t1, kind, pivot, s, position)
    c, sine = np.cos(s * omega), np.sin(s * omega)
    for row in range(3):
        # A row of R exp(w) is the row of R turned back.
        x, y, z = turn(axis, c, -sine, r0[row, 0], r0[row, 1], r0[row, 2])
        rotation[row, 0], rotation[row, 1], rotation[row, 2] = x, y, z
