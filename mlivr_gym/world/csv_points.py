"""Graspable points from a table of comma-separated values."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mlivr_gym.arguments import ANY_NUMBER
from mlivr_gym.errors import MapError, path_shown, shortened
from mlivr_gym.schema import FieldPath
from mlivr_gym.world.map_entries import POINT, metres_of, point_row

COLUMNS = ("id", "x", "y", "z", "nx", "ny", "nz", "rx", "ry", "rz")
"""Columns that a table must have, in any order: the id of a point, its position [m], its outward
normal and the direction of its rail."""

FACE = "face"
"""Column that may be missing; its value is then the name of the file."""


def read_points(path: Path, entries: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Read the points of a table in UTF-8 as plain data, in the unit of other entries of the map.

    A header line names the columns; lines that begin with `#` are comments. Raises a `MapError` if
    the file cannot be read, a column is missing, unknown or named twice, or a row is no point, with
    its line; or if the other entries have points, too.
    """
    if "points" in entries:
        raise MapError(f"points is given beside {path_shown(path)}, which has them; leave it out")
    place = FieldPath("", MapError, metres_of(entries, None))
    try:
        with open(path, encoding="utf-8-sig", newline="") as stream:
            # A comment becomes a blank line, since lines are counted.
            lines = ("\n" if line.lstrip().startswith("#") else line for line in stream)
            return _points(csv.reader(lines), path.stem, place)
    except MapError as fault:
        raise MapError(f"map {path_shown(path)}: {fault}") from None
    except OSError as fault:
        reason = fault.strerror or str(fault)
    except UnicodeDecodeError:
        reason = "it is not UTF-8 text"
    except csv.Error as fault:
        reason = f"it is not a table of comma-separated values: {fault}"
    raise MapError(f"cannot read map {path_shown(path)}: {reason}")


def _points(lines: Any, name: str, place: FieldPath) -> list[dict[str, Any]]:
    """Return the points below the header line, the first one that is not blank."""
    header = [column.strip() for column in next(filter(None, lines), [])]
    for column in (*COLUMNS, *header):
        known, count = column in (*COLUMNS, FACE), header.count(column)
        if not known or count != 1:
            fault = "lacks" if not count else "names twice" if known else "has the unknown"
            raise MapError(
                f"line {lines.line_num} {fault} the column {shortened(column)}; the columns are "
                f"{', '.join(COLUMNS)} and, if you like, {FACE}"
            )
    points: list[dict[str, Any]] = []
    line_of: dict[str, int] = {}
    for row in lines:
        if not any(map(str.strip, row)):
            continue
        line = lines.line_num
        if len(row) != len(header):
            raise MapError(f"line {line} has {len(row)} values; the header has {len(header)}")
        values, here = dict(zip(header, map(str.strip, row), strict=True)), f"line {line}: "
        numbers = [
            ANY_NUMBER.read(_number(values[column]), place.field(f"{here}{column}"))
            for column in COLUMNS[1:]
        ]
        vectors = {"position": numbers[:3], "normal": numbers[3:6], "rail": numbers[6:]}
        point = {"id": values["id"], "face": values.get(FACE) or name, **vectors}
        point_row(POINT.read(point, place.field(here)), place.field(here))
        before = line_of.setdefault(point["id"], line)
        if before != line:
            raise MapError(f"{here}id is {point['id']!r}, which line {before} has already")
        points.append(point)
    return points


def _number(text: str) -> float | str:
    """Return the number that a text is, or what is none as it is."""
    try:
        return float(text)
    except ValueError:
        return text
