"""Cargo in a limb: a bag is picked up, carried by a folded limb while the others walk, and stowed.

A bag on the body is a field of the robot (`RobotSpec.cargo`).
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.cargo.cargo_mission import CargoMission, plan_cargo_mission
    from mlivr_gym.extensions.cargo.carrying import carrying_robot

__all__ = ["CargoMission", "carrying_robot", "plan_cargo_mission"]

COMMANDS = {
    "carry": (
        "pick a bag up, carry it with one limb and stow it, in MuJoCo",
        "mlivr-gym carry --robot mlivr3 --cargo 10 0.2 0.2 0.2 --start D3a:8 D3a:1 D3a:4 "
        "--pick D2b:3 --stow F2b:4",
    ),
}

__getattr__, __dir__ = lazy(__name__)
