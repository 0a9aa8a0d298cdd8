"""What the package keeps in its cache folder: listed, cleared, and limited in size.

Only what the package writes is looked at, by its name: the folder may be one that has other files.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from mlivr_gym.compiled.cache import cache_folder, kernel_root

TABLES = {
    "all steps of two limbs": r"(pairs|steps)-[0-9a-f]+\.npz",
    "all nodes of three or four limbs": r"nodes-[0-9a-f]+(-mapped\.npz|-\d+\.npy|\.npz|\.xz)",
    "sets of points within reach": r"sets-[0-9a-f-]+\.npz",
    "part of a table that was not finished": r"parts-[0-9a-f-]+",
}
"""Names of what is kept of graphs, by what it is."""

UNFINISHED = r"\.{}\.\w+"
"""How `files.write_whole` calls what is not yet written."""

MACHINE_CODE = "machine code"


class CachedFile(NamedTuple):
    """A file or folder that is kept."""

    path: Path
    what: str
    size: int
    """[bytes]"""
    used: float
    """When it was used last [s since the epoch], as far as the system of files tells."""


def cached_files() -> list[CachedFile]:
    """All that is kept, in the order of names."""
    folder = cache_folder()
    tables = [] if folder is None else [(path, _what(path.name)) for path in _inside(folder)]
    code = [path for path in _inside(kernel_root()) if re.fullmatch("[0-9a-f]{16}", path.name)]
    return [
        _kept(path, what)
        for path, what in [*tables, *((path, MACHINE_CODE) for path in code)]
        if what
    ]


def mark_used(path: Path) -> None:
    """Note that something kept is used now."""
    with suppress(OSError):  # of a folder that may only be read
        os.utime(path)


def least_recently_used(files: Sequence[CachedFile], most: int) -> list[CachedFile]:
    """Those that were not used for longest, without which the others have `most` bytes or less."""
    gone, size = [], sum(one.size for one in files)
    for one in sorted(files, key=lambda one: one.used):
        if size <= most:
            break
        gone.append(one)
        size -= one.size
    return gone


def remove(files: Sequence[CachedFile]) -> list[OSError]:
    """Remove some of what is kept; returns why some cannot be.

    What another process removes at the same time is gone all the same; one that reads it goes on.
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


def _what(name: str) -> str:
    """What something is by its name; empty for what is not of the package."""
    for what, one in TABLES.items():
        if re.fullmatch(one, name) or re.fullmatch(UNFINISHED.format(one), name):
            return what
    return ""


def _inside(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() else []


def _kept(path: Path, what: str) -> CachedFile:
    """One thing with its size and use; of a folder that of its files."""
    size, last = 0, 0.0
    inside = [Path(folder, name) for folder, _, names in os.walk(path) for name in names]
    for file in inside if path.is_dir() else [path]:
        with suppress(FileNotFoundError):  # another process may have removed it
            state = file.stat()
            size, last = size + state.st_size, max(last, state.st_mtime, state.st_atime)
    return CachedFile(path, what, size, last)
