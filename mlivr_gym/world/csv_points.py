"""Graspable points from a table of comma-separated values."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mlivr_gym.errors import MapError, path_shown, shortened
from mlivr_gym.schema import FieldPath
from mlivr_gym.values import MAX_POINTS
from mlivr_gym.world.map_entries import POINT, point_row
from mlivr_gym.world.units import in_metres, metres_per_unit, told_in_metres

VECTORS = {"position": ("x", "y", "z"), "normal": ("nx", "ny", "nz"), "rail": ("rx", "ry", "rz")}
"""Columns of the vectors of a point: position [m], outward normal and direction of the rail."""

REQUIRED_COLUMNS = ("id", *(column for columns in VECTORS.values() for column in columns))
"""Columns that a table must have, in any order."""

FACE = "face"
"""Column that may be missing; its value is then the name of the file."""


class RowPath(FieldPath):
    """Place in a row of a table, with a column for each number of a vector."""

    def field(self, name: str) -> RowPath:
        """Return the place of a field of the point in this row."""
        return RowPath(f"{self.path}: {name}", self.error)

    def entry(self, number: int) -> FieldPath:
        """Return the place of a number of the vector at this place."""
        row, _, vector = self.path.rpartition(": ")
        return FieldPath(f"{row}: {VECTORS[vector][number]}", self.error)


def read_points(path: str | Path, entries: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Read the points of a table in UTF-8 as plain data, in the unit of other entries of the map.

    A header line names the columns; lines that begin with `#` are comments. Raises a `MapError` if
    the file cannot be read, a column is missing, unknown or named twice, or a row is no point, with
    its line; or if the other entries have points, too.
    """
    others = dict(entries or {})
    if "points" in others:
        raise MapError(f"points is given beside {path_shown(path)}, which has them; leave it out")
    metres = metres_per_unit(others, FieldPath("", MapError))
    try:
        with open(path, encoding="utf-8-sig", newline="") as stream, told_in_metres(others):
            return _points(csv.reader(_without_comments(stream)), Path(path).stem, metres)
    except MapError as fault:
        raise MapError(f"map {path_shown(path)}: {fault}") from None
    except OSError as fault:
        reason = fault.strerror or str(fault)
    except UnicodeDecodeError:
        reason = "it is not UTF-8 text"
    except csv.Error as fault:
        reason = f"it is not a table of comma-separated values: {fault}"
    raise MapError(f"cannot read map {path_shown(path)}: {reason}")


def _without_comments(lines: Iterable[str]) -> Iterator[str]:
    """Yield lines, with a blank one in place of each comment, since lines are counted."""
    for line in lines:
        yield "\n" if line.lstrip().startswith("#") else line


def _points(lines: Any, name: str, metres: float) -> list[dict[str, Any]]:
    """Return the points below the header line, the first one that is not blank."""
    header = [column.strip() for column in next(filter(None, lines), [])]
    _check_header(header, lines.line_num or 1)
    points: list[dict[str, Any]] = []
    line_of: dict[str, int] = {}
    for row in lines:
        if not any(value.strip() for value in row):
            continue
        line = lines.line_num
        place = RowPath(f"line {line}", MapError)
        if len(row) != len(header):
            raise place.fault(f"has {len(row)} values; the header has {len(header)}")
        if len(points) == MAX_POINTS:
            raise place.fault(f"is one too many: a map has at most {MAX_POINTS} points")
        values = dict(zip(header, (value.strip() for value in row), strict=True))
        point = {"id": values["id"], FACE: values.get(FACE) or name} | {
            vector: [_number(values[column], column, line) for column in columns]
            for vector, columns in VECTORS.items()
        }
        point_row(POINT.read(in_metres(POINT, point, metres), place), place)
        before = line_of.setdefault(point["id"], line)
        if before != line:
            raise place.field("id").fault(f"is {point['id']!r}, which line {before} has already")
        points.append(point)
    if not points:
        raise MapError("it has no point: each line below the header is one")
    return points


def _check_header(header: list[str], line: int) -> None:
    """Refuse a header that lacks a column, or has one that is unknown or named twice."""
    columns = f"the columns are {', '.join(REQUIRED_COLUMNS)} and, if you like, {FACE}"
    if not any(header):
        raise MapError(f"line {line} is empty; {columns}")
    if len(header) == 1:
        raise MapError(f"line {line} is {shortened(header[0])}, without a comma; {columns}")
    for column in REQUIRED_COLUMNS:
        if column not in header:
            raise MapError(f"line {line} lacks the column {column!r}; {columns}")
    for column in header:
        if column not in (*REQUIRED_COLUMNS, FACE):
            raise MapError(f"line {line} has the unknown column {shortened(column)}; {columns}")
        if header.count(column) > 1:
            raise MapError(f"line {line} names the column {column!r} twice")


def _number(text: str, column: str, line: int) -> float:
    """Return a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise MapError(f"line {line}: {column} is {shortened(text)}; it must be a finite number")
    return value
