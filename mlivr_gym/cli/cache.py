"""The command `mlivr-gym cache`."""

from __future__ import annotations

import argparse
import re
from datetime import datetime

from mlivr_gym.cli.arguments import Add, command, option
from mlivr_gym.cli.outputs import UNITS, file_size
from mlivr_gym.compiled.cache import cache_folder, kernel_root
from mlivr_gym.compiled.cached_files import (
    MACHINE_CODE,
    CachedFile,
    cached_files,
    least_recently_used,
    remove,
)
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.files import FileError


def add_command(add: Add) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    parser = command(
        add,
        run,
        description="List the tables and the machine code that are kept between runs, with their "
        "size and when they were used last. All of it is made again where it is needed.",
    )
    how = parser.add_mutually_exclusive_group()
    option(how, "--clear", "remove all of it")
    told = "remove what was not used for longest until no more than, say, 2GB is kept"
    option(how, "--limit SIZE", told)


def run(args: argparse.Namespace) -> None:
    """List what is kept, or remove some of it."""
    files = cached_files()
    if args.clear or args.limit:
        gone = files if args.clear else least_recently_used(files, _bytes(args.limit))
        faults = remove(gone)
        files = cached_files()
        args.result |= {"removed": len(gone) - len(faults)}
        if faults:
            raise FileError(f"cannot remove {faults[0].filename!r}: {faults[0].strerror}")
        print(f"{len(gone)} removed, {file_size(sum(one.size for one in gone))}")
    tables = [one for one in files if one.what != MACHINE_CODE]
    code = [one for one in files if one.what == MACHINE_CODE]
    size = sum(one.size for one in files)
    args.result |= {
        "folder": cache_folder(),
        "bytes": size,
        "tables": [one._asdict() for one in tables],
        "machine_code": {"folder": kernel_root(), "bytes": sum(one.size for one in code)},
    }
    for one in tables:
        print(_line(one))
    if code:
        last, many = max(one.used for one in code), sum(one.size for one in code)
        print(_line(CachedFile(kernel_root(), MACHINE_CODE, many, last)))
    print(f"{file_size(size)} in {cache_folder() or kernel_root()}")


def _line(one: CachedFile) -> str:
    when = datetime.fromtimestamp(one.used).strftime("%Y-%m-%d %H:%M")
    return f"{file_size(one.size):>9}  {when}  {one.path.name}  {one.what}"


def _bytes(size: str) -> int:
    """A size as it is given, in bytes."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([kMGT]?B)?", size, re.IGNORECASE)
    units = [unit.lower() for unit in UNITS]
    if match is None:
        raise SettingError(f"--limit is {shortened(size)}; it must be a size such as 500MB or 2GB")
    return int(float(match[1]) * 1000 ** units.index((match[2] or "B").lower()))
