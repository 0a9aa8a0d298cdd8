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

from typing import TYPE_CHECKING, Annotated

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Record
from mlivr_gym.kinematics.chain import FlangeAxis
from mlivr_gym.kinematics.inverse import branch_links
from mlivr_gym.kinematics.limb import MountedArm
from mlivr_gym.kinematics.poses import vector

if TYPE_CHECKING:
    from mlivr_gym.values import Triple


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


Matrix6 = Annotated[Array, (6, 6)]
"""Field of a 6 by 6 matrix."""


class Inversion(Record):
    """Scratch of the inversion of a limb's Jacobian."""

    matrix: Matrix6
    """Base twists of the joints in columns, then the inverse of this."""
    pivots: Annotated[IntArray, (6,), np.int64]
    """Row that changed places with each row."""


@kernel
def _set_twist(limb: MountedArm, joint: int, o: Triple, z: Triple, l_c: float, a: Array) -> None:
    """Write the base twist of a joint into a column, by a point on it and its axis."""
    mount, place = limb.mount.rotation, limb.mount.position
    (ox, oy, oz), (ax, ay, az) = vector(place), (0.0, 0.0, 0.0)
    for c in range(3):
        ox, ax = ox + mount[0, c] * o[c], ax + mount[0, c] * z[c]
        oy, ay = oy + mount[1, c] * o[c], ay + mount[1, c] * z[c]
        oz, az = oz + mount[2, c] * o[c], az + mount[2, c] * z[c]
    a[0, joint] = (oy * az - oz * ay) / l_c
    a[1, joint] = (oz * ax - ox * az) / l_c
    a[2, joint] = (ox * ay - oy * ax) / l_c
    a[3, joint], a[4, joint], a[5, joint] = ax, ay, az


@kernel
def _invert(a: Array, pivots: IntArray) -> bool:
    """Invert a matrix in its place, shape (6, 6); return whether it is regular."""
    for k in range(6):
        pivot = k
        for row in range(k + 1, 6):
            if abs(a[row, k]) > abs(a[pivot, k]):
                pivot = row
        if abs(a[pivot, k]) < 1e-12:
            return False
        pivots[k] = pivot
        if pivot != k:
            for c in range(6):
                a[k, c], a[pivot, c] = a[pivot, c], a[k, c]
        scale = 1.0 / a[k, k]
        a[k, k] = 1.0
        for c in range(6):
            a[k, c] *= scale
        for row in range(6):
            if row != k:
                factor = a[row, k]
                a[row, k] = 0.0
                for c in range(6):
                    a[row, c] -= factor * a[k, c]
    for back in range(6):
        k = 5 - back
        pivot = pivots[k]
        if pivot != k:
            for row in range(6):
                a[row, k], a[row, pivot] = a[row, pivot], a[row, k]
    return True


@kernel
def limb_information(
    limb: MountedArm, flange: FlangeAxis, branch: int, l_c: float, scratch: Inversion, out: Array
) -> bool:
    """Compute `K^-1` of one limb on a branch in base axes, shape (6, 6).

    The flange is given by its position and axis, `l_c` is the characteristic length [m]. Returned
    is whether the limb is away from its singularities.
    """
    there, links = branch_links(limb.arm, flange, branch)
    if not there:
        return False
    a = scratch.matrix
    for joint in range(6):
        o, z = flange
        if joint < 5:
            o, z = links[joint].o, links[joint].z
        _set_twist(limb, joint, o, z, l_c, a)
    if not _invert(a, scratch.pivots):
        return False
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(6):
                total += a[k, i] * a[k, j]
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
