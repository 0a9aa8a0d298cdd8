"""Reading JSON files with all their faults reported, and writing files atomically.

Every file of the package is written whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from mlivr_gym.arguments import FileName
from mlivr_gym.errors import MlivrError, path_shown, shortened
from mlivr_gym.schema import FieldPath

T = TypeVar("T")

LARGEST_FILE = 1 << 25
"""Maximum size of a JSON file [bytes]; a map of 100,000 points takes half of it."""

TOO_MANY_DIGITS = 309
"""Number of digits of the smallest integer that is larger than any float."""


class FileError(MlivrError):
    """A file cannot be written."""


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write a file by renaming a finished temporary one, so that no half-written file is ever seen.

    The content is text, which is written in UTF-8, or bytes. Raises a `FileError` if the file
    cannot be written.
    """
    path = FileName().read(path, FieldPath("path", FileError))
    target, name = Path(path), None
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        with os.fdopen(handle, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
            stream.flush()
            os.fsync(stream.fileno())  # else a power cut may leave a whole file of zeros
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, 0o666 & ~umask)
        os.replace(name, target)
        _sync_folder(target.parent)
    except (OSError, ValueError) as error:  # for example a null character in the name
        if name is not None:
            Path(name).unlink(missing_ok=True)
        reason = error.strerror if isinstance(error, OSError) else None
        raise FileError(f"cannot write {path_shown(path)}: {reason or error}") from None


def _sync_folder(folder: Path) -> None:
    """Write a folder's entries to the disk, where the system can do so."""
    with suppress(OSError):  # Windows opens no folders, and some network drives sync none
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def checksum(data: Any, content: bytes = b"") -> str:
    """Return the SHA-256 hash of JSON data and of further bytes, which shows any alteration.

    Spaces and the order of fields do not change it.
    """
    text = json.dumps(data, sort_keys=True)
    return hashlib.sha256(text.encode() + b"\0" + content).hexdigest()


def read_json(path: str | Path, kind: str, error: type[MlivrError] = FileError) -> dict[str, Any]:
    """Return the object that a JSON file in UTF-8 holds; every number in it is finite.

    `kind` is what the file holds, for the message, for example `"map"`. Raises an error of the
    given type, which names the file, if the file cannot be read, is too large or nested too deeply,
    is not JSON, or does not hold an object.
    """
    path = FileName().read(path, FieldPath("path", error))
    try:
        with open(path, "rb") as stream:
            content = stream.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise ValueError(f"it has more than {LARGEST_FILE} bytes")
        data = json.loads(
            content.decode("utf-8-sig"),
            object_pairs_hook=_object,
            parse_constant=_finite,
            parse_float=_finite,
            parse_int=_whole,
        )
        if not isinstance(data, dict):
            raise ValueError(f"it must hold a JSON object, not a {type(data).__name__}")
    except OSError as fault:
        reason = fault.strerror or str(fault)
    except UnicodeDecodeError:
        reason = "it is not UTF-8 text"
    except RecursionError:
        reason = "it is nested too deeply"
    except json.JSONDecodeError as fault:
        reason = f"it is not JSON: {fault}"
    except ValueError as fault:
        reason = str(fault)
    else:
        return data
    raise error(f"cannot read {kind} {path_shown(path)}: {reason}")


def load(
    path: str | Path, kind: str, error: type[MlivrError], build: Callable[[dict[str, Any]], T]
) -> T:
    """Read a JSON file as `read_json` does and return what `build` makes of its object.

    Raises an error of the given type, which names the file, if the file cannot be read or used.
    """
    data = read_json(path, kind, error)
    try:
        return build(data)
    except MlivrError as fault:
        raise error(f"{kind} {str(path)!r}: {fault}") from None


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields of a JSON object, none of which may occur twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"an object has the field {shortened(twice)} twice")
    return found


def _finite(digits: str) -> float:
    """Return a number of a JSON file, which must be finite."""
    value = float(digits)
    if not math.isfinite(value):
        raise ValueError(f"its number {digits[:40]} is not finite")
    return value


def _whole(digits: str) -> int:
    """Return an integer of a JSON file, which must not have too many digits."""
    if len(digits.lstrip("-")) >= TOO_MANY_DIGITS:
        raise ValueError(f"its number {digits[:40]}... has {len(digits)} digits")
    return int(digits)
