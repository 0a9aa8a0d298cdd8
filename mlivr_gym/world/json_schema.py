"""The fields of a map file as a JSON schema, made from the validators that check them.

`python -m mlivr_gym.world.json_schema > envs_assets/map.schema.json` writes the file that ships.
"""

from __future__ import annotations

import json
from typing import Any

from mlivr_gym.json_schema import DRAFT, json_schema_of
from mlivr_gym.schema import Fields, ListOf
from mlivr_gym.world.boxes import BOX_DATA, CORNERS, Boxes
from mlivr_gym.world.map_entries import MODULE, POINTS, AnyMap
from mlivr_gym.world.units import METRES

UNITS_IN_METRE = 1.0 / min(METRES.values())
"""Number of the smallest units of length in a metre."""


def map_schema() -> dict[str, Any]:
    """Return the JSON schema of a map file, as a user or `GraspMap.save` writes it.

    It says what `GraspMap.load` accepts, field by field; what joins several fields, such as the
    right angle of a rail and its normal, is checked on loading alone, and so is the largest length
    in the unit of the map.
    """
    return {
        "$schema": DRAFT,
        "title": "Map of mlivr-gym",
        "description": "Lengths in the unit of the map, by default m. A map with the field ids is "
        "one that GraspMap.save wrote, in m.",
        "if": {"required": ["ids"]},
        "then": json_schema_of(POINTS),
        "else": _in_any_unit(json_schema_of(MODULE)),
    }


def _in_any_unit(part: Any, is_length: bool = False) -> Any:
    """Return a part of a schema whose bounds of lengths [m] hold for their numbers in any unit."""
    if isinstance(part, list):
        return [_in_any_unit(entry, is_length) for entry in part]
    if not isinstance(part, dict):
        return part
    is_length = is_length or part.get("description") == "[m]"
    out = {name: _in_any_unit(inner, is_length) for name, inner in part.items()}
    if "description" in out and is_length:
        out["description"] = "length"
    if "maximum" in out and is_length:
        out["maximum"] *= UNITS_IN_METRE
    if out.get("minimum", 0.0) < 0.0 and is_length:
        out["minimum"] *= UNITS_IN_METRE
    return out


@json_schema_of.register
def _of_boxes(kind: Boxes) -> dict[str, Any]:
    """Return the schema of boxes from their corners, or from middle and half edges."""
    needed = ("id", "centre", "half")
    centred = Fields(
        {name: BOX_DATA.validators[name] for name in needed},
        {name: part for name, part in BOX_DATA.validators.items() if name not in needed},
    )
    forms = [json_schema_of(CORNERS), json_schema_of(centred)]
    return json_schema_of(ListOf(centred)) | {"items": {"anyOf": forms}}


@json_schema_of.register
def _of_part(kind: AnyMap) -> dict[str, Any]:
    """Return the schema of a map in a map: its name or file, or the fields of one."""
    return {"anyOf": [{"type": "string"}, {"$ref": "#"}]}


if __name__ == "__main__":
    print(json.dumps(map_schema(), indent=1))
