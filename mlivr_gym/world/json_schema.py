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


def map_schema() -> dict[str, Any]:
    """Return the JSON schema of a map file, as a user or `GraspMap.save` writes it.

    It says what `GraspMap.load` accepts, field by field; what joins several fields, such as the
    right angle of a rail and its normal, is checked on loading alone.
    """
    return {
        "$schema": DRAFT,
        "title": "Map of mlivr-gym",
        "description": "Lengths in m. A map with the field ids is one that GraspMap.save wrote.",
        "if": {"required": ["ids"]},
        "then": json_schema_of(POINTS),
        "else": json_schema_of(MODULE),
    }


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
