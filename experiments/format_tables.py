"""Write the tables of file fields of `docs/formats.md` from the schemas that check the files."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from math import inf
from typing import Any

from reports import table

import mlivr_gym.robot.limb_dynamics as arms
import mlivr_gym.robot.validators as robots
import mlivr_gym.schema as schema
import mlivr_gym.world.boxes as boxes
import mlivr_gym.world.map_entries as maps
from mlivr_gym.motion import Trajectory
from mlivr_gym.motion.plan_files import FORMAT, PLAN_FILE, STATISTICS, motion_fields, step_fields
from mlivr_gym.robot.limb import LIMB
from mlivr_gym.robot.mounts import MOUNT
from mlivr_gym.robot.specification import ROBOT
from mlivr_gym.robot.visuals import VISUAL
from mlivr_gym.simulation import Recording
from mlivr_gym.world.rails import HANDRAIL, SEGMENT

LIMBS, STANCES = 13, 17
"""Numbers that stand for N limbs and K stances in schemas that depend on them."""

TRAJECTORY_KEYS = {"point_ids": "points"}
"""Names in trajectory files of the fields of `Trajectory` that are called otherwise."""

SYMBOLS = {LIMBS: "N", STANCES: "K", STANCES - 1: "K - 1"}
"""Symbols that these numbers are replaced with."""

MEANINGS = {
    "name": "Short name of the map.",
    "unit": "Unit of all lengths, those of the maps of `parts` excepted; `m` if it is omitted.",
    "points": "Graspable points, see below.",
    "segments": "Straight rails that carry points, see below.",
    "spacing": "Distance of points along a segment.",
    "handrails": "Handrails: obstacles that also remove graspable points, see below.",
    "clearance": "Distance of points from the footprints of handrails.",
    "cabin": "Lower and upper corner of the box in which the base may be; by default the "
    "bounding box of all points, enlarged by 1.5 m.",
    "boxes": "Boxes that must not be touched, see *Obstacles*.",
    "mesh": "Mesh whose surface must not be touched: its file, relative to that of the map, the "
    "edge of the cubes that cover it (`resolution` [m], 0.05), and metres per unit (`scale`, 1).",
    "parts": "Maps placed in this one, see below; their points, segments and boxes are added to "
    "its own, with `id/` before their ids.",
    "map": "Name of a map that ships, file (relative to that of this map), or the map itself.",
    "translation": "Where the origin of the part lies in this map.",
    "rotation": "Rows of the rotation from the frame of the part to that of this map.",
    "occupied": "Ids of points that no limb may hold.",
    "id": "Unique name.",
    "face": "Name of the face on which it lies.",
    "position": "Position.",
    "normal": "Outward surface normal, of length 1.",
    "rail": "Direction of the rail, at right angles to the normal.",
    "start": "One end, in the middle of the rail's surface.",
    "end": "The other end.",
    "width": "Width of the rail.",
    "thickness": "Height of the rail above its face.",
    "axis": "Axis along which the bar runs.",
    "bar_min": "Lower corner of the bar alone, without its posts.",
    "bar_max": "Upper corner of the bar alone.",
    "min": "Lower corner.",
    "max": "Upper corner.",
    "format": f"Version of the format, {FORMAT}.",
    "rules": "Version of the rules of the stance graph.",
    "query": "Query of the plan, see below.",
    "world": "World in which the plan was made, see below.",
    "motion": "Stances, steps and configurations, see below.",
    "statistics": "Results and effort of the search, see below.",
    "checksum": "SHA-256 of the other fields (`files.checksum`); optional.",
} | dict.fromkeys(maps.REMARKS, "Remark for readers; not used by the program.")
"""Meanings of the fields that no class documents."""


def in_words(kind: Any) -> str:
    """Return in words what a value must be, by the validator that reads it."""
    match kind:
        case schema.OrNone():
            return f"{in_words(kind.kind)}, or null"
        case robots.OneOrList():
            return f"{in_words(kind.one)}, or {in_words(kind.listed)}"
        case arms.Named():
            return f"{in_words(kind.kind)}, or {_one_of(arms.ARMS)}"
        case maps.AnyMap():
            return "text, or object"
        case schema.Text():
            return "text"
        case schema.Flag():
            return "true or false"
        case schema.Choice():
            return _one_of(kind.options)
        case robots.PairOf():
            return _one_of([" ".join(pair) for pair in kind.pairs])
        case schema.Rotation():
            return "rotation matrix, by rows"
        case schema.Integer():
            return f"whole number{_range(kind.least, kind.most)}"
        case schema.Numbers():
            return _numbers(kind)
        case boxes.Boxes():
            return "list of objects"
        case schema.ListOf():
            count = f"{_size(kind.most)} " if kind.least == kind.most else ""
            return f"list of {count}" + re.sub("^(text|object)", "\\1s", in_words(kind.kind))
        case schema.Struct():
            return in_words(kind.fields)
        case schema.Fields():
            names = ", ".join(f"`{name}`" for name in kind.required)
            return f"object with {names}" if 0 < len(kind.required) < 3 else "object"
    return "anything"


def _one_of(names: Sequence[str]) -> str:
    return "one of " + ", ".join(f"`{name}`" for name in names)


def _size(count: int) -> str:
    return SYMBOLS.get(count, str(count))


def _numbers(kind: schema.Numbers) -> str:
    """Return shape, unit and range of numbers in words."""
    least, most = kind.rows
    rows = _size(most) if least == most else "k"
    sizes = [rows if size is None else _size(size) for size in kind.shape]
    what = f"numbers, shape ({', '.join(sizes)}{',' * (len(sizes) == 1)})" if sizes else "number"
    unit = f" [{kind.unit}]" if kind.unit else ""
    bound = -kind.most if kind.unit == "m" and kind.least == -inf else kind.least
    return f"{what}{unit}{_range(bound, kind.most)}"


def _range(least: float, most: float) -> str:
    if most >= 1 << 31:
        return "" if least == -inf else f", at least {least:g}"
    top = f"{SYMBOLS[most + 1]} - 1" if most + 1 in SYMBOLS else f"{most:g}"  # type: ignore[index]
    return f", at most {top}" if least == -inf else f", {least:g} to {top}"


def attributes(made: type) -> dict[str, str]:
    """Return the descriptions of a class's attributes, inherited ones first, from docstrings."""
    base = made.__base__
    found = attributes(base) if dataclasses.is_dataclass(base) else {}
    source = ast.parse(inspect.getsource(made)).body[0]
    assert isinstance(source, ast.ClassDef)
    return found | {
        ast.unparse(field.target): inspect.cleandoc(ast.literal_eval(text.value)).replace("\n", " ")
        for field, text in pairwise(source.body)
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr)
    }


def rows(kind: Any, meanings: Mapping[str, str]) -> Iterator[tuple[str, ...]]:
    """Yield a table row for each field of an object."""
    parts = kind.fields if isinstance(kind, schema.Struct) else kind
    for part, needed in ((parts.required, "yes"), (parts.optional, "")):
        for name, inner in part.items():
            meaning = meanings[name].replace("|", "\\|")
            yield f"`{name}`", needed, in_words(inner), meaning


def fields(kind: Any, made: type | None = None, title: str = "") -> str:
    """Return the table of an object's fields, below its title."""
    made = kind.made if made is None and isinstance(kind, schema.Struct) else made
    meanings = MEANINGS | (attributes(made) if made is not None else {})
    head = f"{title}\n\n" if title else ""
    return head + table("field | needed | value | meaning", rows(kind, meanings))


def tables() -> dict[str, str]:
    """Return the tables by the names of their marks."""
    point = maps.MODULE.optional["points"].kind  # type: ignore[attr-defined]
    robot, capsules = ROBOT, ROBOT.validators["capsules"].kind.kind  # type: ignore[attr-defined]
    query, world = PLAN_FILE.required["query"], PLAN_FILE.required["world"]
    step, motion = step_fields(LIMBS), motion_fields(STANCES, LIMBS)
    return {
        "fields_map": "\n".join(
            (
                fields(maps.MODULE),
                fields(point, title="A point:"),
                fields(SEGMENT, title="A segment:"),
                fields(HANDRAIL, title="A handrail:"),
                fields(maps.PART, title="A part:"),
            )
        ),
        "fields_obstacles": fields(boxes.OBSTACLES),
        "fields_box": fields(boxes.BOX_DATA),
        "fields_robot": "\n".join(
            (
                fields(robot),
                fields(LIMB, title="A limb:"),
                fields(arms.LIMB_DYNAMICS, title="The dynamics of a limb:"),
                fields(capsules, title="A capsule:"),
                fields(MOUNT, title="A mount:"),
                fields(VISUAL, title="A visual mesh:"),
            )
        ),
        "fields_plan": "\n".join(
            (
                fields(PLAN_FILE),
                fields(query, title="`query`:"),
                fields(world, title="`world`; its settings are those of `Settings`:"),
                fields(motion, title="`motion`, of K stances and N limbs:"),
                fields(step, title="A step:"),
                fields(STATISTICS, title="`statistics`:"),
            )
        ),
        "fields_trajectory": table(
            "field | meaning",
            (
                (f"`{TRAJECTORY_KEYS.get(name, name)}`", meaning)
                for name, meaning in attributes(Trajectory).items()
            ),
        ),
        "fields_recording": table(
            "field | meaning",
            ((f"`{name}`", meaning) for name, meaning in attributes(Recording).items()),
        ),
    }
