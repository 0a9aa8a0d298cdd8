"""Joint angles and Jacobians of an arm on its branches, as the kernels give them."""

from functools import cache

import numpy as np
from compiled import called

from mlivr_gym.kinematics.chain import Chain, FlangeAxis
from mlivr_gym.kinematics.chain_record import set_chain
from mlivr_gym.kinematics.inverse import SINGULAR_TOO, branch_angles


def triple(vector):
    """Three numbers as compiled code takes them."""
    return tuple(vector.tolist())


def flange_axis(pose):
    """Position and axis of a flange pose, shape (4, 4), as compiled code takes them."""
    return FlangeAxis(triple(pose[:3, 3]), triple(pose[:3, 2]))


@cache
def arm_of(limb):
    """The arm of a limb as compiled code reads it; all who ask for it share it."""
    out = Chain.row()
    set_chain(out, limb.steps, limb.senses, limb.windows)
    return out


def angles_on(arm, p, r, branch, slack=SINGULAR_TOO):
    """Joint angles at a flange pose in the limb base frame on one branch; None out of reach."""
    q = np.full(6, np.nan)
    flange = FlangeAxis(triple(p), triple(r[:, 2]))
    found = called(branch_angles)(arm, flange, triple(r[:, 0]), branch, slack, q)
    return q if found else None


def branch_of(arm, pose, q):
    """The branch of joint angles at their flange pose."""
    _, out = solutions(arm, pose[:3, 3], pose[:3, :3])
    return int(np.nanargmin(np.abs(np.exp(1j * out) - np.exp(1j * q)).max(axis=1)))


def solutions(arm, p, r, slack=SINGULAR_TOO):
    """The branches that reach a flange pose as a mask, and the angles, NaN where there are none."""
    mask, out = 0, np.full((8, 6), np.nan)
    for branch in range(8):
        q = angles_on(arm, p, r, branch, slack)
        if q is not None:
            mask, out[branch] = mask | 1 << branch, q
    return mask, out
