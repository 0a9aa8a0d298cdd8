"""An upper bound of the distance of a limb's flange from its mount at a given `w_m`."""

from __future__ import annotations

import numpy as np

from mlivr_gym.robot.limb import Limb

CELLS = 256
"""Number of intervals of joint 3, and of joint 5, over which bounds are taken."""


def farthest_flange(limb: Limb, characteristic_length: float, w_m: float) -> float:
    """Return an upper bound of the distance of a limb's flange from its mount [m].

    The bound holds for all joint angles with limb manipulability of at least `w_m`, which requires
    `|s3 s5 u| >= c` with `c = w_m l_c^3 / |a2 a3|`. In the arm's plane the flange lies at most `D +
    sqrt(d5^2 + d6^2 s5^2)` from the shoulder, where `D` is the distance to the forearm end, and at
    least `|u| - d6 |s5|` from the axis of joint 1; perpendicular to the plane it lies at most `d4 +
    d6 |c5|` away. The resulting distance is maximised over cells of joints 3 and 5, where each term
    takes its most favourable value in the cell.

    Parameters
    ----------
    limb
        The limb.
    characteristic_length
        Characteristic length l_c [m].
    w_m
        Required limb manipulability.

    Returns
    -------
    float
        The bound [m]; 0 if no joint angles reach `w_m`.
    """
    d1, a2, a3, d4, d5, d6 = np.abs(limb.lengths)
    q3, q5 = (np.linspace(0.0, top, CELLS + 1) for top in (np.pi, 0.5 * np.pi))
    forearm = np.sqrt(np.maximum(a2**2 + a3**2 + 2.0 * a2 * a3 * np.cos(q3[:-1]), 0.0))[:, None]
    middle = (q3[:-1] <= 0.5 * np.pi) & (q3[1:] >= 0.5 * np.pi)
    s3 = np.where(middle, 1.0, np.maximum(np.sin(q3[:-1]), np.sin(q3[1:])))[:, None]
    s5, c5 = np.sin(q5[1:]), np.cos(q5[:-1])
    u = w_m * characteristic_length**3 / (a2 * a3 * s3 * s5)
    possible = u <= forearm + d5
    if not possible.any():
        return 0.0
    plane = forearm + np.sqrt(d5**2 + (d6 * s5) ** 2)
    radial = np.maximum(u - d6 * s5, 0.0)
    height = np.sqrt(np.maximum(plane**2 - radial**2, 0.0))
    square = plane**2 + d1**2 + 2.0 * d1 * height + (d4 + d6 * c5) ** 2
    return float(np.sqrt(square[possible].max()))
