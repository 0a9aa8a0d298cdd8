"""How a limb is read from plain data: by its frames, or by the lengths of an arm of UR."""

from __future__ import annotations

from mlivr_gym.robot.chain_limb import CHAIN_LIMB, ChainLimb
from mlivr_gym.robot.limb import LIMB, Limb
from mlivr_gym.schema import FieldPath

AnyLimb = Limb | ChainLimb
"""A limb."""


class LimbValidator:
    """Validator of a limb; plain data without frames are lengths of an arm of UR."""

    def read(self, value: object, place: FieldPath) -> AnyLimb:
        """Return the limb of plain data, or a limb as it is."""
        if isinstance(value, dict) and "family" in value:
            raise place.field("family").fault(
                f"is {value['family']!r}; limbs are no longer told by families: give origins and "
                "quaternions of its links, or read the arm from its URDF or MJCF"
            )
        if isinstance(value, ChainLimb) or (isinstance(value, dict) and "origins" in value):
            return CHAIN_LIMB.read(value, place)
        return LIMB.read(value, place)


ANY_LIMB = LimbValidator()
"""Validator of the field `limb` of a robot."""
