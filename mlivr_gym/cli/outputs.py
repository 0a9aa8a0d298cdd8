"""Files that a command will write, claimed before it begins.

A command writes nothing before all that can be refused has been: so it claims its files, works
everything out, and writes in the end. What is refused or fails leaves nothing behind.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from mlivr_gym.files import FileError

MAX_NAMED = 3
"""Most earlier files that are named; of others their number is told."""

UNITS = ("B", "kB", "MB", "GB", "TB")
"""Units of sizes, each a thousand of the one before."""


def file_size(count: float) -> str:
    """A number of bytes in words."""
    unit = 0
    while count >= 999.5 and unit + 1 < len(UNITS):
        count, unit = count / 1000.0, unit + 1
    return f"{count:.3g} {UNITS[unit]}"


def rough_duration(seconds: float) -> str:
    """A time that is not known exactly in words."""
    if seconds < 90.0:
        return f"{max(round(seconds), 1)} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def check_outputs(*files: str | Path | None, folder: str | Path | None = None) -> None:
    """Refuse files that could not be written, and say which earlier ones will be replaced.

    That is said on standard error, also with `--quiet`, and before anything is worked out, so that
    an interruption still keeps them.

    Parameters
    ----------
    files
        The files; None for those that were not asked for.
    folder
        A folder that `make_folder` will make, in which they lie; else theirs must be there.

    Raises
    ------
    FileError
        If a file cannot be written, or two would be one.
    """
    replaced: list[str] = []
    seen: set[Path] = set()
    for file in files:
        if file is None:
            continue
        path = Path(file)
        try:
            _check(path, Path(folder) if folder is not None else None)
            place = path.resolve()
            if path.exists():
                replaced.append(str(path))
        except (OSError, ValueError) as error:  # such as a null character in the name
            raise FileError(f"cannot write {str(file)!r}: {_reason(error)}") from None
        if place in seen:
            raise FileError(f"cannot write {str(file)!r}: it would be written twice")
        seen.add(place)
    if replaced:
        more = len(replaced) - MAX_NAMED
        names = ", ".join(replaced[:MAX_NAMED]) + (f" and {more} more" if more > 0 else "")
        print(f"mlivr-gym: will be replaced: {names}", file=sys.stderr, flush=True)


def make_folder(folder: str | Path) -> Path:
    """Make a folder, and those that it lies in.

    Raises
    ------
    FileError
        If it cannot be made.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise FileError(f"cannot make folder {str(folder)!r}: {_reason(error)}") from None
    return path


def _check(path: Path, folder: Path | None) -> None:
    if not path.name or path.is_dir():
        raise IsADirectoryError("it is a folder")
    parent = path.parent
    while path.parent == folder and not parent.exists() and parent != parent.parent:
        parent = parent.parent  # what there is of the folder
    if not parent.exists():
        raise FileNotFoundError(f"there is no folder {str(parent)!r}")
    if not parent.is_dir():
        raise NotADirectoryError(f"{str(parent)!r} is no folder")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise PermissionError(f"folder {str(parent)!r} may not be written")


def _reason(error: OSError | ValueError) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
