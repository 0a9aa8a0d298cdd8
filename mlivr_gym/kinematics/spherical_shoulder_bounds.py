"""How the joints and links of an arm with a spherical shoulder move at most, proved (compiled).

The bounds are those of `spherical_wrist_bounds` for the form that begins at the flange, see
`spherical_shoulder`. Let the point P of the flange travel at most `d` in the limb base frame, the
flange axis turn at most `a` and the flange at most `w`, and let D be the distance of S from P. The
form begins at a frame that moves with P and the flange axis but does not turn about it. Seen from
there the base turns by at most `a`, and S, its wrist point, travels by at most `d + a (D + d)`.
Joint 6, about which the flange turns against that frame, turns by `w` more than joint 1 of the
form.

Joints 1 and 2, and 2 and 3, are at right angles: link 2 turns by at most `hypot(q1, q2)`, a later
link by the sum of the turns of the joints before it. S does not move in links 0 to 3, the elbow
moves with link 3 about S, and P with link 4 about the elbow. Followed from the grasp P does not
move, and the elbow moves with link 4 about P.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.kernels import kernel
from mlivr_gym.compiled.records import Joints
from mlivr_gym.kinematics import spherical_wrist_bounds
from mlivr_gym.kinematics.arm import Arm
from mlivr_gym.kinematics.turns import FlangeMotion, GraspMotion, Turns


@kernel
def _travel(arm: Arm, cosine: float, d: float, a: float) -> float:
    """Bound the travel of S, seen from the flange, by the cosine of the elbow angle [m]."""
    square = arm.upper * arm.upper + arm.forearm * arm.forearm + arm.d2 * arm.d2
    distance = np.sqrt(max(square + 2.0 * arm.upper * arm.forearm * cosine, 0.0))
    travel: float = d + a * (distance + d)
    return travel


@kernel
def stays_above(
    arm: Arm, terms: Array, choice: int, change: tuple[float, float], square_floor: float
) -> bool:
    """Return whether the bounds keep a class of branches above the floor on an interval."""
    d, a = change
    seen = _travel(arm, terms[choice, 2], d, a), a
    return spherical_wrist_bounds.stays_above(arm, terms, choice, seen, square_floor)


@kernel
def held_turns(arm: Arm, q: Joints, flange: FlangeMotion, turns: Turns) -> bool:
    """Bound how far joints turn on their path from the middle of an interval to its ends."""
    d, a, w = flange
    cosine = np.cos(q[3]) * arm.c_bend + np.sin(q[3]) * arm.s_bend
    seen = FlangeMotion(_travel(arm, cosine, d, a), a, a)
    if not spherical_wrist_bounds.bent_turns(arm, (q[4], q[3], q[1]), seen, turns):
        return False
    q1, q2, q3 = turns.q6, turns.q5, turns.q4
    turns.q4, turns.q5, turns.q6 = turns.q3, turns.q2, w + turns.q1
    turns.q1, turns.q2, turns.q3 = q1, q2, q3
    turns.q23 = abs(arm.c_held) * q2 + q3
    return bool(turns.q6 < np.pi)


@kernel
def link_motion(arm: Arm, turns: Turns, shift: Array, spin: Array) -> None:
    """Bound how far links turn and anchors move, seen from the links 0 to 4.

    Anchors are S, the elbow in place of elbow and forearm end, and P.
    """
    upper = np.hypot(arm.upper, arm.d2)
    for row in range(5):
        spin[row, 0] = 0.0
        spin[row, 1] = turns.q1 if row < 1 else 0.0
        spin[row, 2] = np.hypot(spin[row, 1], turns.q2) if row < 2 else 0.0
        spin[row, 3] = spin[row, 2] + turns.q3 if row < 3 else 0.0
        spin[row, 4] = spin[row, 3] + turns.q4 if row < 4 else 0.0
        spin[row, 5] = spin[row, 4] + turns.q5
        spin[row, 6] = spin[row, 5] + turns.q6
        shift[row, 0] = 0.0
        shift[row, 1] = shift[row, 2] = arm.forearm * spin[row, 3]
        shift[row, 3] = shift[row, 1] + upper * spin[row, 4]


@kernel
def grasp_motion(arm: Arm, turns: Turns) -> GraspMotion:
    """Bound how far the links of a limb that holds move in the world, followed from its grasp."""
    wrist_2 = turns.q6
    wrist_1 = wrist_2 + turns.q5
    fore = wrist_1 + turns.q4
    elbow = np.hypot(arm.upper, arm.d2) * wrist_1
    return GraspMotion(wrist_2, wrist_1, fore, fore + turns.q3, elbow, elbow)
