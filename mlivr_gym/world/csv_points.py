"""Graspable points from a table of comma-separated values."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

from mlivr_gym.errors import MapError, path_shown, shortened
from mlivr_gym.values import MAX_POINTS

VECTORS = {"position": ("x", "y", "z"), "normal": ("nx", "ny", "nz"), "rail": ("rx", "ry", "rz")}
"""Columns of the vectors of a point: position [m], outward normal and direction of the rail."""

REQUIRED_COLUMNS = ("id", *(column for columns in VECTORS.values() for column in columns))
"""Columns that a table must have, in any order."""

FACE = "face"
"""Column that may be missing; its value is then the name of the file."""


def read_points(path: str | Path) -> dict[int, dict[str, Any]]:
    """Read the points of a table in UTF-8 as plain data, by the number of their line.

    A header line names the columns. Raises a `MapError` if the file cannot be read, a column is
    missing, unknown or named twice, or a value is not a finite number; the message names the line.
    """
    try:
        with open(path, encoding="utf-8-sig", newline="") as stream:
            return _points(csv.reader(stream), Path(path).stem)
    except MapError as fault:
        raise MapError(f"map {path_shown(path)}: {fault}") from None
    except OSError as fault:
        reason = fault.strerror or str(fault)
    except UnicodeDecodeError:
        reason = "it is not UTF-8 text"
    except csv.Error as fault:
        reason = f"it is not a table of comma-separated values: {fault}"
    raise MapError(f"cannot read map {path_shown(path)}: {reason}")


def _points(lines: Any, name: str) -> dict[int, dict[str, Any]]:
    """Return the points below the header line."""
    header = [column.strip() for column in next(lines, [])]
    _check_header(header)
    points: dict[int, dict[str, Any]] = {}
    for row in lines:
        if not any(value.strip() for value in row):
            continue
        line = lines.line_num
        if len(row) != len(header):
            raise MapError(f"line {line} has {len(row)} values; the header has {len(header)}")
        if len(points) == MAX_POINTS:
            raise MapError(f"line {line}: a map has at most {MAX_POINTS} points")
        values = dict(zip(header, (value.strip() for value in row), strict=True))
        points[line] = {"id": values["id"], FACE: values.get(FACE) or name} | {
            vector: [_number(values[column], column, line) for column in columns]
            for vector, columns in VECTORS.items()
        }
    return points


def _check_header(header: list[str]) -> None:
    """Refuse a header that lacks a column, or has one that is unknown or named twice."""
    columns = f"the columns are {', '.join(REQUIRED_COLUMNS)} and, if you like, {FACE}"
    for column in REQUIRED_COLUMNS:
        if column not in header:
            raise MapError(f"line 1 lacks the column {column!r}; {columns}")
    for column in header:
        if column not in (*REQUIRED_COLUMNS, FACE):
            raise MapError(f"line 1 has the unknown column {shortened(column)}; {columns}")
        if header.count(column) > 1:
            raise MapError(f"line 1 names the column {column!r} twice")


def _number(text: str, column: str, line: int) -> float:
    """Return a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise MapError(f"line {line}: {column} is {shortened(text)}; it must be a finite number")
    return value
