"""How the joints and links of an arm of the UR family move at most, proved (compiled).

On a line in joint space the turns of the joints are known. A limb whose flange is given (it holds
while the base moves, or departs along the normal) is solved in the middle and at both ends of an
interval. Between them let the wrist point travel at most `d` in the limb base frame, the flange
axis turn at most `a` and the flange at most `w`, from the middle to either end. Then

    u^2    >= (rho - d)^2 - d4^2
    q1     changes by at most b1 = d / u_min            (|dq1/dw| = 1/u exactly)
    |s5|   >= |s5| - (a + b1)
    z4     turns by at most b4 = (a + b1) / s5_min      (z4 = +-(y1 x z6) / |s5|)
    D      changes by at most e = d + |d4| b1 + |d5| b4 (shoulder to forearm end)

and the range of D bounds `s3^2`. With the least `u`, `|s5|` and `|s3|` of the interval the joints
turn at most, each along its path,

    q1              d / u                                 = b1
    q5              a + b1                                (the angle between z6 and y1)
    q2 + q3 + q4    (a + b1) / |s5|                       = b4
    q2              e / (|a2| |s3|)
    q2 + q3         e / (|a3| |s3|)
    q3              e D / (|a2 a3| |s3|)
    q3 + q4, q4     b4 plus that of q2, of q2 + q3
    q6              w + b1 + b4

where those of q2 and q2 + q3 are the parts of the forearm end's velocity along the other link.
Joints 2 to 4 are parallel and at right angles to joint 1, so link k up to 4 turns by
`hypot(q1, q2 + .. + qk)`, and joint 5 adds its turn.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints
from mlivr_gym.kinematics.arm import Arm
from mlivr_gym.kinematics.turns import FlangeMotion, GraspMotion, Turns


@kernel
def stays_above(
    arm: Arm, terms: Array, choice: int, change: tuple[float, float], square_floor: float
) -> bool:
    """Return whether the bounds keep a class of branches above the floor on an interval."""
    d, a = change
    k2 = arm.a2 * arm.a2 + arm.a3 * arm.a3
    rho = np.sqrt(terms[choice, 0] + arm.d4 * arm.d4)
    u2_min = (rho - d) ** 2 - arm.d4 * arm.d4 if rho > d else -1.0
    b1 = d / np.sqrt(u2_min) if u2_min > 0.0 else np.inf
    s5_min = np.sqrt(terms[choice, 1]) - (a + b1)
    if not s5_min > 0.0:
        return False
    distance = np.sqrt(k2 + 2.0 * arm.a2 * arm.a3 * terms[choice, 2])
    change_of_distance = d + abs(arm.d4) * b1 + abs(arm.d5) * (a + b1) / s5_min
    closest = distance - change_of_distance if distance > change_of_distance else 0.0
    low = (closest * closest - k2) / (2.0 * arm.a2 * arm.a3)
    high = ((distance + change_of_distance) ** 2 - k2) / (2.0 * arm.a2 * arm.a3)
    s3_2_min = 1.0 - max(low * low, high * high)
    stays: bool = s3_2_min > 0.0 and u2_min * s5_min * s5_min * s3_2_min >= square_floor
    return stays


@kernel
def held_turns(arm: Arm, q: Joints, flange: FlangeMotion, turns: Turns) -> bool:
    """Bound how far joints turn on their path from the middle of an interval to its ends."""
    d, a, w = flange
    c2, c23, s234 = np.cos(q[1]), np.cos(q[1] + q[2]), np.sin(q[1] + q[2] + q[3])
    u, links = abs(arm.a2 * c2 + arm.a3 * c23 + arm.d5 * s234), abs(arm.a2 * arm.a3)
    rho = np.sqrt(u * u + arm.d4 * arm.d4) - d
    u2 = rho * rho - arm.d4 * arm.d4
    if rho <= 0.0 or u2 <= 0.0:
        return False
    b1 = d / np.sqrt(u2)
    s5 = abs(np.sin(q[4])) - (a + b1)
    if s5 <= 0.0:
        return False
    b4 = (a + b1) / s5
    e, k2 = d + abs(arm.d4) * b1 + abs(arm.d5) * b4, arm.a2 * arm.a2 + arm.a3 * arm.a3
    distance = np.sqrt(max(k2 + 2.0 * arm.a2 * arm.a3 * np.cos(q[2]), 0.0))
    farthest, closest = distance + e, max(distance - e, 0.0)
    c3 = max(abs(farthest * farthest - k2), abs(closest * closest - k2)) / (2.0 * links)
    if c3 >= 1.0:
        return False
    s3 = np.sqrt(1.0 - c3 * c3)
    turns.q1, turns.q234, turns.q5, turns.q6 = b1, b4, a + b1, w + b1 + b4
    turns.q2, turns.q23 = e / (abs(arm.a2) * s3), e / (abs(arm.a3) * s3)
    turns.q3 = min(e * farthest / (links * s3), turns.q2 + turns.q23)
    turns.q34, turns.q4 = b4 + turns.q2, b4 + turns.q23
    most = max(turns.q2, turns.q23, turns.q34, turns.q4, turns.q6)
    return bool(most < np.pi)


@kernel
def link_motion(arm: Arm, turns: Turns, shift: Array, spin: Array) -> None:
    """Bound how far links turn and anchors move, seen from the links 0 to 4."""
    reach = np.sqrt(arm.d4**2 + arm.d5**2)
    for row in range(5):
        for link in range(7):
            spin[row, link] = 0.0
    for row in range(2):
        first = turns.q1 if row == 0 else 0.0
        spin[row, 1], spin[row, 2] = first, np.hypot(first, turns.q2)
        spin[row, 3], spin[row, 4] = np.hypot(first, turns.q23), np.hypot(first, turns.q234)
    spin[2, 3], spin[2, 4], spin[3, 4] = turns.q3, turns.q34, turns.q4
    for row in range(5):
        spin[row, 5] = spin[row, 6] = spin[row, 4] + turns.q5
        shift[row, 0] = 0.0
        shift[row, 1] = abs(arm.a2) * spin[row, 2]
        shift[row, 2] = shift[row, 1] + abs(arm.a3) * spin[row, 3]
        shift[row, 3] = shift[row, 2] + reach * spin[row, 4]


@kernel
def grasp_motion(arm: Arm, turns: Turns) -> GraspMotion:
    """Bound how far the links of a limb that holds move in the world, followed from its grasp."""
    wrist_2 = turns.q6
    wrist_1 = wrist_2 + turns.q5
    fore, upper = wrist_1 + turns.q4, wrist_1 + turns.q34
    end = np.hypot(arm.d4, arm.d5) * wrist_1
    return GraspMotion(wrist_2, wrist_1, fore, upper, end, end + abs(arm.a3) * fore)
