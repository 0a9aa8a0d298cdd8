"""Joint angles of a limb at many poses at once (compiled)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.kinematics.families import SINGULAR_TOO
from mlivr_gym.kinematics.holding import next_angles
from mlivr_gym.kinematics.limb import Angles, angles_at
from mlivr_gym.kinematics.poses import Pose


@entry
def joints_along(
    robots: Any, i: int, bases: Any, flanges: Any, branch: int, reference: Angles, out: Any
) -> int:
    """Compute joint angles of a limb on one branch at many poses, continuous from given ones.

    Bases in the world are rows of `Pose`, shape (k,), or (1,) for one that stays; flanges likewise,
    up to a half turn about their z axes. `reference` has angles close to those at the first pose,
    which determine windings and flip. Rows of `Angles`, shape (k,), are filled; returned is the
    number of poses from the first on at which the branch exists.
    """
    limb, half_turn = robots[0].limbs[i], 0.0
    for k in range(len(out)):
        base, flange = bases[min(k, len(bases) - 1)], flanges[min(k, len(flanges) - 1)]
        q = out[k].q
        for joint in range(6):
            q[joint] = reference.q[joint] if k == 0 else out[k - 1].q[joint]
        if k == 0:
            if not angles_at(limb, base, flange, branch, SINGULAR_TOO, q):
                return k
            if np.cos(reference.q[5] - q[5]) < 0.0:
                half_turn = np.pi
            for joint in range(6):
                q[joint] = reference.q[joint]
        q[5] -= half_turn
        if not next_angles(limb, base, flange, branch, q):
            return k
        q[5] += half_turn
    return len(out)


def poses(positions: Array, rotations: Array) -> Any:
    """Return rows of `Pose` from positions, shape (k, 3) [m], and rotations, shape (k, 3, 3)."""
    out = Pose.rows(len(positions))
    out["position"], out["rotation"] = positions, rotations
    return out
