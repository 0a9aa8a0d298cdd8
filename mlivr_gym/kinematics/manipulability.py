"""Limb and base manipulability.

`limb_manipulability` and `base_manipulability` are the definitions (Yoshikawa
1985; Chiacchio 1991 as extended by the paper) in NumPy. The planner uses the
compiled forms below, which agree with them wherever no limb is singular:

    w_m = |a2 a3 s3 s5 u| / l_c^3
    w_b = det(sum_i K_i^-1)^(-1/2),   K_i = (S A_i)(S A_i)^T

where `A_i` is the base twist that limb i alone gives and `S = diag(1/l_c, 1/l_c,
1/l_c, 1, 1, 1)` (Stocco 1999). A joint's twist is taken at the base origin, so that
`A_i` is minus the limb's Jacobian there and no further transform is needed.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.stack_arrays import floats
from mlivr_gym.kinematics.ur import limb_axes


def scaling(characteristic_length: float) -> Array:
    """S, which divides linear rows by the characteristic length [m]; shape (6, 6)."""
    return np.diag([1.0 / characteristic_length] * 3 + [1.0] * 3)


def limb_manipulability(jacobian: Array, characteristic_length: float) -> float:
    """`w_m = sqrt(det(SJ (SJ)^T))` of a limb Jacobian of shape (6, n), linear rows first."""
    normalised = scaling(characteristic_length) @ jacobian
    return float(np.sqrt(max(np.linalg.det(normalised @ normalised.T), 0.0)))


def base_manipulability(
    limb_jacobians: Array, grasps_from_base: Array, characteristic_length: float
) -> float:
    """`w_b` by its null-space definition.

    Rigid grasps give `J_b v_b + J_sup qdot = 0`. `N_c` spans the null space of
    `(I - J_b J_b^+) J_sup`, `J_eq = -J_b^+ J_sup N_c`, `w_b = sqrt(det(S J_eq (S J_eq)^T))`.

    Args:
        limb_jacobians: Shape (N, 6, n); each maps joint rates to the twist of the grasp, linear
            rows first, in base axes.
        grasps_from_base: Shape (N, 3); grasp positions from the base origin in base axes [m].
        characteristic_length: l_c [m].
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


@kernel
def limb_information(
    p: Array, z: Array, lengths: Array, branch: int, mount_rotation: Array, mount_position: Array,
    l_c: float, out: Array,
) -> bool:  # fmt: skip
    """`K^-1` of one limb in base axes, written into `out`, shape (6, 6).

    Args:
        p: Flange position in the limb base frame [m], shape (3,).
        z: Flange axis in the limb base frame, shape (3,).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        branch: Branch label.
        mount_rotation: Limb base axes in the body frame, shape (3, 3).
        mount_position: Limb base origin in the body frame [m], shape (3,).
        l_c: Characteristic length [m].
        out: Filled with `K^-1`.

    Returns:
        Whether the limb is away from its singularities.
    """
    axes = floats(6, 3)
    origins = floats(6, 3)
    if not limb_axes(p, z, lengths, branch, axes, origins):
        return False
    a = floats(6, 12)
    for k in range(6):
        for row in range(3):
            axis = 0.0
            for c in range(3):
                axis += mount_rotation[row, c] * axes[k, c]
            a[3 + row, k] = axis
        ox, oy, oz = mount_position
        for c in range(3):
            ox += mount_rotation[0, c] * origins[k, c]
            oy += mount_rotation[1, c] * origins[k, c]
            oz += mount_rotation[2, c] * origins[k, c]
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
def inverse_root_determinant(m: Array, scratch: Array) -> float:
    """`det(m)^(-1/2)` of a symmetric positive definite matrix, shape (6, 6), by Cholesky."""
    product = 1.0
    for i in range(6):
        for j in range(i + 1):
            total = m[i, j]
            for k in range(j):
                total -= scratch[i, k] * scratch[j, k]
            if i == j:
                if total <= 0.0:
                    return 0.0
                scratch[i, i] = np.sqrt(total)
                product *= scratch[i, i]
            else:
                scratch[i, j] = total / scratch[j, j]
    return 1.0 / product
