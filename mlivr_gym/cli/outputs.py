"""The files that a command writes: checked before it starts, and written together at its end.

A command first checks its output files, then computes everything, and writes at the end. Hence a
command that is refused or fails leaves no files behind.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from types import MappingProxyType

from mlivr_gym.files import FileError, make_folder, plain_file, reason, written_together

MAX_NAMED = 3
"""Maximum number of replaced files that are listed by name; the others are counted."""

INPUTS = ("map", "robot", "obstacles", "plan", "hyperparameters")
"""Options of commands that may name a file to be read; `init` names a checkpoint without suffix."""


def input_files(args: argparse.Namespace) -> dict[Path, str]:
    """Return the option of each file that a command reads, by the resolved path of the file."""
    found: dict[Path, str] = {}
    for name in INPUTS:
        given = getattr(args, name, None)
        for file in given if isinstance(given, list) else [given]:
            if isinstance(file, str) and os.path.isfile(file):
                found[Path(file).resolve()] = f"--{name}"
    if getattr(args, "init", None):
        for suffix in (".pt", ".json"):
            found[Path(args.init).with_suffix(suffix).resolve()] = "--init"
    return found


def check_outputs(
    *files: str | Path | None,
    folder: str | Path | None = None,
    inputs: Mapping[Path, str] = MappingProxyType({}),
) -> None:
    """Refuse files that cannot be written, and announce which existing files will be replaced.

    The announcement goes to standard error, even with `--quiet`, before anything is computed, so
    that an interruption still saves the old files. A file is None if it was not requested; `folder`
    is the one that `all_or_none` will make later, and all others must exist. A `FileError` also
    names an output that is among `input_files`, or that has the name of another output. Devices and
    pipes are not replaced; they must only be there to be written to.
    """
    replaced: list[str] = []
    seen: set[Path] = set()
    for file in files:
        if file is None:
            continue
        try:
            target = _target(file, None if folder is None else Path(folder))
            if target is None:
                continue
            if target in inputs:
                raise ValueError(
                    f"it is the file of {inputs[target]}, which would be replaced; give the output "
                    "another name"
                )
            if target in seen:
                raise ValueError("two outputs have this name; give each its own")
        except (OSError, ValueError) as error:  # also of a null character in the name
            raise FileError(f"cannot write {str(file)!r}: {reason(error)}") from None
        seen.add(target)
        if target.exists():
            replaced.append(str(file))
    if replaced:
        more = len(replaced) - MAX_NAMED
        names = ", ".join(replaced[:MAX_NAMED]) + (f" and {more} more" if more > 0 else "")
        print(f"mlivr-gym: existing files to be replaced: {names}", file=sys.stderr, flush=True)


@contextmanager
def all_or_none(args: argparse.Namespace, folder: str | Path | None = None) -> Iterator[None]:
    """Write the files of a block at its end, all of them or, if it fails, none.

    What the block prints is printed when they are there. A folder for them is made if it is
    missing, and removed if it stays empty; the results of a command that fails name no files.
    """
    told, missing = io.StringIO(), list[Path]()
    if folder is not None:
        missing = [one for one in (Path(folder), *Path(folder).parents) if not one.exists()]
        make_folder(folder)
    try:
        with redirect_stdout(told), written_together():
            yield
    except BaseException:
        for one in missing:
            with suppress(OSError):
                one.rmdir()
        for name in ("files", "folder"):
            args.result.pop(name, None)
        raise
    print(told.getvalue(), end="", flush=True)


def _target(file: str | Path, folder: Path | None) -> Path | None:
    """Return the plain file that a path leads to, None for a device or a pipe.

    Raises an `OSError` if it cannot be written; `folder` may be made later.
    """
    path = Path(file)
    try:
        target = plain_file(file)
    except NotADirectoryError:  # told below, in other words
        target = path
    if target is None:
        if not os.access(path, os.W_OK):
            raise PermissionError("no permission to write")
        return None
    if path.is_symlink():
        path = target
    parent = path.parent
    while path.parent == folder and not parent.exists() and parent != parent.parent:
        parent = parent.parent  # the nearest folder that exists
    if not parent.exists():
        raise FileNotFoundError(f"folder {str(parent)!r} does not exist")
    if not parent.is_dir():
        raise NotADirectoryError(f"{str(parent)!r} is not a folder")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise PermissionError(f"no permission to write in folder {str(parent)!r}")
    return target
