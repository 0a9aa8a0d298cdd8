"""Where the wrist point of an arm with a spherical wrist is, seen from its shoulder (compiled)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mlivr_gym.compiled.kernels import kernel

if TYPE_CHECKING:
    from mlivr_gym.kinematics.arm import Arm


@kernel
def in_elbow_plane(arm: Arm, cosine: float, sine: float) -> tuple[float, float]:
    """Return W seen from the shoulder in the plane across axis 3, along `b2` and `a2` [m].

    Parameters are cosine and sine of the elbow angle.
    """
    c, s = cosine * arm.c_fold + sine * arm.s_fold, sine * arm.c_fold - cosine * arm.s_fold
    return arm.b2 - arm.forearm * s, arm.a2 + arm.forearm * c


@kernel
def along_axis_2(arm: Arm, cosine: float, sine: float) -> float:
    """Return how far W lies along axis 2 [m], by cosine and sine of the elbow angle."""
    along: float = arm.c_held * arm.d2 - arm.s_held * in_elbow_plane(arm, cosine, sine)[0]
    return along
