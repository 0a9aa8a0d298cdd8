"""How the record of an arm is filled with its lengths."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.arm import LIMIT_TOLERANCE, NUMERIC, TURN, UR, Arm
from mlivr_gym.kinematics.numeric_seeds import set_chain, set_seeds


def _cosine_and_sine(angle: float) -> tuple[float, float]:
    """Return cosine and sine of an angle [rad], 0 where a quarter turn leaves a rounding error."""
    pair = np.cos(angle), np.sin(angle)
    cosine, sine = (0.0 if abs(part) < 1e-15 else float(part) for part in pair)
    return cosine, sine


STEPS = 72
"""Number of figures of the frames of six links, each origin and axes."""


def set_arm(arm: Arm, figures: Array, windows: Array, family: int = UR) -> None:
    """Fill `arm` with the figures of a limb, `robot.limb.LimbBase.lengths`, and windows.

    Figures are signs and zeros of the six joints, the lengths of the form, and of an arm that
    deviates from it the frames of its links, `NumericArm.steps`. Windows are the least and largest
    angle of each joint [rad], at most a turn apart, shape (6, 2).
    """
    arm["family"] = family
    arm["sign"][:], arm["zero"][:], lengths = figures[:6], figures[6:12], figures[12:]
    arm["deviates"] = int(family != NUMERIC and len(lengths) > STEPS)
    if family == NUMERIC:
        set_seeds(arm, np.reshape(lengths, (6, 4, 3)), _windows_of_form(arm, windows))
    elif family == UR:
        arm["d1"], arm["a2"], arm["a3"], arm["d4"], arm["d5"], arm["d6"] = lengths[:6]
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
    if arm["deviates"]:
        set_chain(arm, np.reshape(lengths[-STEPS:], (6, 4, 3)))
    low, high = windows.T
    arm["window"][:, 0] = low
    arm["window"][:, 1] = np.minimum(high, low + TURN - 2.0 * LIMIT_TOLERANCE)


def _windows_of_form(arm: Arm, windows: Array) -> Array:
    """Return windows at the angles of the form [rad], shape (6, 2)."""
    turned = arm["sign"][:, None] * windows + arm["zero"][:, None]
    return np.sort(turned, axis=1)
