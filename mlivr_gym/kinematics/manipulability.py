"""Limb and base manipulability.

`limb_manipulability` and `base_manipulability` are the definitions (Yoshikawa
1985; Chiacchio 1991 as extended by the paper) in NumPy. The planner uses the
compiled forms below, which agree with them wherever no limb is singular:

    w_m = |det J| / l_c^3, det J by `inverse.branch_sizes`
    w_b = det(sum_i K_i^-1)^(-1/2),   K_i = (S A_i)(S A_i)^T

where `A_i` is the base twist that limb i alone gives and `S = diag(1/l_c, 1/l_c,
1/l_c, 1, 1, 1)` (Stocco 1999). A joint's twist is taken at the base origin, so that
`A_i` is minus the limb's Jacobian there and no further transform is needed.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record
from mlivr_gym.kinematics.chain import FlangeAxis
from mlivr_gym.kinematics.inverse import branch_frames
from mlivr_gym.kinematics.limb import MountedArm


def scaling(characteristic_length: float) -> Array:
    """Return S, which divides linear rows by the characteristic length [m]; shape (6, 6)."""
    return np.diag([1.0 / characteristic_length] * 3 + [1.0] * 3)


def limb_manipulability(jacobian: Array, characteristic_length: float) -> float:
    """Return `w_m = sqrt(det(SJ (SJ)^T))` of a limb Jacobian of shape (6, n), linear rows first."""
    normalised = scaling(characteristic_length) @ jacobian
    return float(np.sqrt(max(np.linalg.det(normalised @ normalised.T), 0.0)))


def base_manipulability(
    limb_jacobians: Array, grasps_from_base: Array, characteristic_length: float
) -> float:
    """Return `w_b` by its null-space definition.

    Rigid grasps give `J_b v_b + J_sup qdot = 0`. `N_c` spans the null space of `(I - J_b J_b^+)
    J_sup`, `J_eq = -J_b^+ J_sup N_c`, `w_b = sqrt(det(S J_eq (S J_eq)^T))`. Limb Jacobians, shape
    (N, 6, n), map joint rates to the twist of the grasp, linear rows first, in base axes; grasp
    positions from the base origin have shape (N, 3), in base axes [m].
    """
    count, _, joints = limb_jacobians.shape
    j_base = np.zeros((6 * count, 6))
    j_support = np.zeros((6 * count, joints * count))
    for i, (limb_jacobian, (x, y, z)) in enumerate(
        zip(limb_jacobians, grasps_from_base, strict=True)
    ):
        transfer = np.eye(6)
        transfer[:3, 3:] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        j_base[6 * i : 6 * i + 6] = transfer
        j_support[6 * i : 6 * i + 6, joints * i : joints * (i + 1)] = limb_jacobian
    inverse = np.linalg.pinv(j_base)
    constraint = (np.eye(6 * count) - j_base @ inverse) @ j_support
    _, values, rows = np.linalg.svd(constraint)
    rank = int((values > 1e-9).sum())
    j_equivalent = -inverse @ j_support @ rows[rank:].T
    return limb_manipulability(j_equivalent, characteristic_length)


class Inversion(Record):
    """Scratch of the inversion of a limb's Jacobian."""

    frames: Annotated[Array, (7, 4, 3)]
    """Frames of the limb's links in its mount, see `chain.link_frames`."""
    matrix: Annotated[Array, (6, 12)]
    """Base twists of the joints, and beside them what becomes the inverse."""


@kernel
def limb_information(
    limb: MountedArm, flange: FlangeAxis, branch: int, l_c: float, scratch: Inversion, out: Array
) -> bool:
    """Compute `K^-1` of one limb on a branch in base axes, shape (6, 6).

    The flange is given by its position and axis, `l_c` is the characteristic length [m]. Returned
    is whether the limb is away from its singularities.
    """
    frames = scratch.frames
    if not branch_frames(limb.arm, flange, branch, frames):
        return False
    a = scratch.matrix
    mount, place = limb.mount.rotation, limb.mount.position
    for k in range(6):
        ox, oy, oz = place[0], place[1], place[2]
        for c in range(3):
            ox += mount[0, c] * frames[k + 1, 0, c]
            oy += mount[1, c] * frames[k + 1, 0, c]
            oz += mount[2, c] * frames[k + 1, 0, c]
        for row in range(3):
            axis = 0.0
            for c in range(3):
                axis += mount[row, c] * frames[k + 1, 3, c]
            a[3 + row, k] = axis
        ax, ay, az = a[3, k], a[4, k], a[5, k]
        a[0, k] = (oy * az - oz * ay) / l_c
        a[1, k] = (oz * ax - ox * az) / l_c
        a[2, k] = (ox * ay - oy * ax) / l_c
        for c in range(6):
            a[k, 6 + c] = 1.0 if c == k else 0.0
    for k in range(6):
        pivot = k
        for row in range(k + 1, 6):
            if abs(a[row, k]) > abs(a[pivot, k]):
                pivot = row
        if abs(a[pivot, k]) < 1e-12:
            return False
        if pivot != k:
            for c in range(12):
                a[k, c], a[pivot, c] = a[pivot, c], a[k, c]
        scale = 1.0 / a[k, k]
        for c in range(k, 12):
            a[k, c] *= scale
        for row in range(6):
            if row != k:
                factor = a[row, k]
                for c in range(k, 12):
                    a[row, c] -= factor * a[k, c]
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(6):
                total += a[k, 6 + i] * a[k, 6 + j]
            out[i, j] = total
            out[j, i] = total
    return True


@kernel
def inverse_root_determinant(work: Array) -> float:
    """Return `det(m)^(-1/2)` of a symmetric positive definite matrix by Cholesky.

    The matrix is `work[0]`, shape (6, 6); its root is written into `work[1]`.
    """
    product = 1.0
    for i in range(6):
        for j in range(i + 1):
            total = work[0, i, j]
            for k in range(j):
                total -= work[1, i, k] * work[1, j, k]
            if i == j:
                if total <= 0.0:
                    return 0.0
                work[1, i, i] = np.sqrt(total)
                product *= work[1, i, i]
            else:
                work[1, i, j] = total / work[1, j, j]
    return 1.0 / product
