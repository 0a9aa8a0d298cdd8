"""A limb of any kind, and how it is read from plain data."""

from __future__ import annotations

from mlivr_gym.robot.chain_limb import CHAIN, CHAIN_LIMB, ChainLimb
from mlivr_gym.robot.limb import FAMILIES, LIMB, Limb
from mlivr_gym.robot.spherical_wrist_limb import SPHERICAL_WRIST_LIMB, SphericalWristLimb
from mlivr_gym.robot.ssrms_limb import SSRMS, SSRMS_LIMB, SsrmsLimb
from mlivr_gym.schema import Choice, FieldPath, Struct

AnyLimb = Limb | SphericalWristLimb | ChainLimb
"""A limb of any kind; an `SsrmsLimb` is a `Limb`, whose joints that move are those of one."""

LIMB_FAMILIES: dict[str, Struct[AnyLimb]] = {
    FAMILIES[0]: LIMB,  # type: ignore[dict-item]
    FAMILIES[1]: SPHERICAL_WRIST_LIMB,  # type: ignore[dict-item]
    SSRMS: SSRMS_LIMB,  # type: ignore[dict-item]
    CHAIN: CHAIN_LIMB,  # type: ignore[dict-item]
}
"""Fields of a limb of each kind, by the names in robot files."""


class LimbValidator:
    """Validator of a limb of any kind; plain data without a family are lengths of a UR arm."""

    def read(self, value: object, place: FieldPath) -> AnyLimb:
        """Return the limb of plain data, or a limb as it is."""
        if isinstance(value, SphericalWristLimb | SsrmsLimb | ChainLimb):
            return value
        family = FAMILIES[0]
        if isinstance(value, dict) and "family" in value:
            names = tuple(LIMB_FAMILIES)
            family = Choice(names).read(value["family"], place.field("family"))
            if family == FAMILIES[0]:
                value = {name: entry for name, entry in value.items() if name != "family"}
        return LIMB_FAMILIES[family].read(value, place)


LIMB_OF_FAMILY = LimbValidator()
"""Validator of the field `limb` of a robot."""
