"""The fields of files as JSON schemas, made from the validators that check them."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import numpy as np

from mlivr_gym.schema import (
    Anything,
    Choice,
    Fields,
    Flag,
    Integer,
    ListOf,
    Numbers,
    OrNone,
    Rotation,
    Struct,
    Text,
)

DRAFT = "https://json-schema.org/draft/2020-12/schema"
"""The version of JSON Schema."""


@singledispatch
def json_schema_of(kind: Any) -> dict[str, Any]:
    """Return the JSON schema of what a kind of validator reads.

    A module that has further kinds registers them (`json_schema_of.register`). Raises a `TypeError`
    if the kind is not registered.
    """
    match kind:
        case Anything():
            return {}
        case OrNone():
            return {"anyOf": [json_schema_of(kind.kind), {"type": "null"}]}
        case Text():
            return {"type": "string", "minLength": kind.least, "maxLength": kind.most}
        case Flag():
            return {"type": "boolean"}
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
            return json_schema_of(kind.fields)
        case Fields():
            parts = {**kind.required, **kind.optional}
            return {
                "type": "object",
                "properties": {name: json_schema_of(part) for name, part in parts.items()},
                "required": list(kind.required),
                "additionalProperties": kind.others,
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
