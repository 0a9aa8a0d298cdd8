"""The command `mlivr-gym cache`."""

from __future__ import annotations

import argparse
import re
from datetime import datetime

from mlivr_gym.cli.arguments import option
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


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    group = parser.add_mutually_exclusive_group()
    option(group, "--clear", "remove all of them")
    text = "remove the least recently used until at most this size remains, such as 500MB or 2GB"
    option(group, "--limit SIZE", text)


def run(args: argparse.Namespace) -> None:
    """List the tables and the machine code that are stored between runs.

    Their sizes and when they were last used are listed. Whatever is removed is computed again when
    it is needed.
    """
    files = cached_files()
    if args.clear or args.limit:
        removed = files if args.clear else least_recently_used(files, _bytes(args.limit))
        faults = remove(removed)
        files = cached_files()
        args.result |= {"removed": len(removed) - len(faults)}
        if faults:
            raise FileError(f"cannot remove {faults[0].filename!r}: {faults[0].strerror}")
        print(f"removed: {len(removed)} files, {file_size(sum(file.size for file in removed))}")
    tables = [file for file in files if file.what != MACHINE_CODE]
    code = [file for file in files if file.what == MACHINE_CODE]
    size = sum(file.size for file in files)
    args.result |= {
        "folder": cache_folder(),
        "bytes": size,
        "tables": [file._asdict() for file in tables],
        "machine_code": {"folder": kernel_root(), "bytes": sum(file.size for file in code)},
    }
    for file in tables:
        print(_line(file))
    if code:
        last_used, code_size = max(file.used for file in code), sum(file.size for file in code)
        print(_line(CachedFile(kernel_root(), MACHINE_CODE, code_size, last_used)))
    print(f"{file_size(size)} in {cache_folder() or kernel_root()}")


def _line(file: CachedFile) -> str:
    """Return the line of a file: size, time of last use, name and content."""
    when = datetime.fromtimestamp(file.used).strftime("%Y-%m-%d %H:%M")
    return f"{file_size(file.size):>9}  {when}  {file.path.name}  {file.what}"


def _bytes(size: str) -> int:
    """Return the number of bytes of a size such as `"2GB"`."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([kMGT]?B)?", size, re.IGNORECASE)
    units = [unit.lower() for unit in UNITS]
    if match is None:
        raise SettingError(f"--limit is {shortened(size)}; it must be a size such as 500MB or 2GB")
    return int(float(match[1]) * 1000 ** units.index((match[2] or "B").lower()))
