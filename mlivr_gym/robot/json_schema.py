"""The fields of a robot file as a JSON schema, made from the validators that check them.

`python -m mlivr_gym.robot.json_schema > envs_assets/robot.schema.json` writes the file that ships.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from mlivr_gym.robot.any_limb import LIMB_FAMILIES, LimbValidator
from mlivr_gym.robot.limb_dynamics import ARMS, Named
from mlivr_gym.robot.specification import ROBOT
from mlivr_gym.robot.validators import PairOf, SizeOrEdges
from mlivr_gym.schema import Choice, Integer, ListOf, Numbers, OrNone, Rotation, Struct, Text

DRAFT = "https://json-schema.org/draft/2020-12/schema"
"""The version of JSON Schema."""


def robot_schema() -> dict[str, Any]:
    """Return the JSON schema of a robot file.

    It says what `RobotSpec.load` accepts, field by field; what joins several fields, such as the
    order of two limits, is checked on loading alone.
    """
    return {
        "$schema": DRAFT,
        "title": "Robot of mlivr-gym",
        "description": "Lengths in m, angles in rad, masses in kg; all fields may be left out.",
        **json_schema_of(ROBOT),
    }


def json_schema_of(kind: Any) -> dict[str, Any]:
    """Return the JSON schema of what a kind reads.

    Raises a `TypeError` if the kind is none of those that robots have.
    """
    match kind:
        case OrNone():
            return {"anyOf": [json_schema_of(kind.kind), {"type": "null"}]}
        case Named():
            return {"anyOf": [json_schema_of(kind.kind), {"enum": list(ARMS)}]}
        case LimbValidator():
            return {"anyOf": [json_schema_of(kind) for kind in LIMB_FAMILIES.values()]}
        case SizeOrEdges():
            return {"anyOf": [json_schema_of(kind.edge), json_schema_of(kind.edges)]}
        case PairOf():
            return {"enum": [list(pair) for pair in kind.pairs]}
        case Text():
            return {"type": "string", "minLength": kind.least, "maxLength": kind.most}
        case Choice():
            return {"enum": list(kind.options)}
        case Integer():
            return {"type": "integer", "minimum": kind.least, "maximum": kind.most}
        case Numbers():
            return _numbers(kind)
        case Rotation():
            row = _listed({"type": "number"}, (3, 3))
            return {"description": "rotation matrix, by rows", **_listed(row, (3, 3))}
        case ListOf():
            return _listed(json_schema_of(kind.kind), (kind.least, kind.most))
        case Struct():
            fields = kind.fields
            parts = {**fields.required, **fields.optional}
            return {
                "type": "object",
                "properties": {name: json_schema_of(part) for name, part in parts.items()},
                "required": list(fields.required),
                "additionalProperties": False,
            }
    raise TypeError(f"no JSON schema for {kind!r}")


def _numbers(kind: Numbers) -> dict[str, Any]:
    """Return the schema of numbers in lists of a shape."""
    out: dict[str, Any] = {"type": "number"}
    least = kind.least if np.isfinite(kind.least) or kind.unit != "m" else -kind.most
    for name, bound in (("minimum", least), ("maximum", kind.most)):
        if np.isfinite(bound):
            out[name] = float(bound)
    for size in kind.shape[::-1]:
        out = _listed(out, kind.rows if size is None else (size, size))
    return {"description": f"[{kind.unit}]", **out} if kind.unit else out


def _listed(entry: dict[str, Any], count: tuple[int, int]) -> dict[str, Any]:
    """Return the schema of a list of entries, of a least and a largest number."""
    return {"type": "array", "items": entry, "minItems": count[0], "maxItems": count[1]}


if __name__ == "__main__":
    print(json.dumps(robot_schema(), indent=1))
