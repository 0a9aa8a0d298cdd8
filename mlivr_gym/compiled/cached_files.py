"""Files of the package in its cache folder: listed, removed, and limited in total size.

Only files whose names are those of this package are considered, since the folder may contain
others.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from mlivr_gym.compiled.cache import cache_folder, kernel_root

TABLES = {
    "table of a stance graph": r"(table|stances|nodes|pairs|steps)-[0-9a-f]+(-\w+)?"
    r"\.(npz|npy|xz)(\.checked)?",
    "sets of points within reach": r"sets-[0-9a-f-]+\.npz",
    "part of a table that was not finished": r"parts-[0-9a-f-]+",
}
"""Patterns of the names of cached tables, by their description."""

UNFINISHED = r"\.{}\.\w+"
"""Pattern of the temporary name that `files.write_whole` gives to a file until it is complete."""

MACHINE_CODE = "machine code"
"""Description of a folder of machine code."""


class CachedFile(NamedTuple):
    """A cached file or folder."""

    path: Path
    what: str
    size: int
    """Size [bytes]."""
    used: float
    """Time of its last use [s since the epoch], as precise as the file system records it."""


def cached_files() -> list[CachedFile]:
    """Return all cached files and folders of the package: tables, then machine code."""
    folder = cache_folder()
    tables = [] if folder is None else [(path, _description(path.name)) for path in _inside(folder)]
    code = [path for path in _inside(kernel_root()) if re.fullmatch("[0-9a-f]{16}", path.name)]
    return [
        _cached_file(path, what)
        for path, what in [*tables, *((path, MACHINE_CODE) for path in code)]
        if what
    ]


def mark_used(path: Path) -> None:
    """Record that a cached file is used now; the time when it was written stays."""
    with suppress(OSError):  # a folder without permission to write
        os.utime(path, ns=(time.time_ns(), path.stat().st_mtime_ns))


def least_recently_used(files: Sequence[CachedFile], most: int) -> list[CachedFile]:
    """Return the least recently used files, whose removal leaves at most `most` bytes."""
    gone, size = [], sum(one.size for one in files)
    for one in sorted(files, key=lambda one: one.used):
        if size <= most:
            break
        gone.append(one)
        size -= one.size
    return gone


def remove(files: Sequence[CachedFile]) -> list[OSError]:
    """Remove cached files; return the errors of those that could not be removed.

    A file that another process removes at the same time is no error; a process that is reading a
    removed file can go on.
    """
    faults = []
    for one in files:
        try:
            if one.path.is_dir():
                shutil.rmtree(one.path)
            else:
                one.path.unlink()
        except FileNotFoundError:
            pass
        except OSError as error:
            faults.append(error)
    return faults


def _description(name: str) -> str:
    """Return the description of a file by its name, empty if it is not of this package."""
    for what, one in TABLES.items():
        if re.fullmatch(one, name) or re.fullmatch(UNFINISHED.format(one), name):
            return what
    return ""


def _inside(folder: Path) -> list[Path]:
    """Return the entries of a folder in the order of their names, none if it does not exist."""
    return sorted(folder.iterdir()) if folder.is_dir() else []


def _cached_file(path: Path, what: str) -> CachedFile:
    """Return a file with its size and last use, or a folder with those of all files in it."""
    size, last = 0, 0.0
    inside = [Path(folder, name) for folder, _, names in os.walk(path) for name in names]
    for file in inside if path.is_dir() else [path]:
        with suppress(FileNotFoundError):  # another process may have removed it
            state = file.stat()
            size, last = size + state.st_size, max(last, state.st_mtime, state.st_atime)
    return CachedFile(path, what, size, last)
