"""How the record of an arm is filled with its lengths."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.arm import LIMIT_TOLERANCE, NUMERIC, TURN, UR, Arm
from mlivr_gym.kinematics.numeric_seeds import set_numeric


def _cosine_and_sine(angle: float) -> tuple[float, float]:
    """Return cosine and sine of an angle [rad], 0 where a quarter turn leaves a rounding error."""
    pair = np.cos(angle), np.sin(angle)
    cosine, sine = (0.0 if abs(part) < 1e-15 else float(part) for part in pair)
    return cosine, sine


def set_arm(arm: Arm, lengths: Array, windows: Array, family: int = UR) -> None:
    """Fill `arm` with lengths of a limb, `robot.limb.LimbBase.lengths`, and windows.

    Windows are the least and largest angle of each joint [rad], at most a turn apart, shape (6, 2).
    """
    arm["family"] = family
    if family == NUMERIC:
        set_numeric(arm, np.reshape(lengths, (6, 4, 3)), windows)
    elif family == UR:
        arm["d1"], arm["a2"], arm["a3"], arm["d4"], arm["d5"], arm["d6"] = lengths
        arm["links"] = abs(arm["a2"] * arm["a3"])
        arm["c_held"], arm["s_held"] = 1.0, 0.0
    else:
        names = ("d1", "a1", "d2", "a2", "b2", "a3", "d4", "d6")
        for name, length in zip(names, lengths[:8], strict=True):
            arm[name] = length
        arm["c_twist"], arm["s_twist"] = _cosine_and_sine(lengths[8])
        arm["c_held"], arm["s_held"] = _cosine_and_sine(lengths[9])
        upper, forearm = np.hypot(arm["a2"], arm["b2"]), np.hypot(arm["a3"], arm["d4"])
        fold, bend = np.arctan2(arm["b2"], arm["a2"]), np.arctan2(arm["a3"], arm["d4"])
        arm["c_fold"], arm["s_fold"] = _cosine_and_sine(fold)
        arm["c_bend"], arm["s_bend"] = _cosine_and_sine(bend - fold)
        arm["upper"], arm["forearm"] = upper, forearm
        arm["links"] = upper * forearm * abs(arm["s_twist"])
    low, high = windows.T
    arm["window"][:, 0] = low
    arm["window"][:, 1] = np.minimum(high, low + TURN - 2.0 * LIMIT_TOLERANCE)
