"""What a robot still reaches once a joint has failed.

A locked joint is a part of a robot (`RobotSpec.with_failed_joint`); here are the state in which the
failure leaves it, and tables of what stays reachable.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.failed_joints.failed_joints import Reach, after_failure, reach_without

__all__ = ["Reach", "after_failure", "reach_without"]

COMMANDS = {
    "failures": (
        "count what a robot still reaches with each joint of a limb locked",
        "mlivr-gym failures --robot mlivr2-iiwa --limb-threshold 0.05",
    ),
}

__getattr__, __dir__ = lazy(__name__)
