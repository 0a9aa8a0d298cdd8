"""Reading JSON files with all their faults reported, and writing files atomically.

Every file of the package is written whole or not at all, and so are several that belong together.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from mlivr_gym.arguments import FileName
from mlivr_gym.errors import MlivrError, path_shown, shortened
from mlivr_gym.schema import FieldPath

T = TypeVar("T")

LARGEST_FILE = 1 << 25
"""Maximum size of a JSON file [bytes]; a map of 100,000 points takes half of it."""

DEEPEST = 500
"""Maximum number of objects and lists around a value; Python's own limit differs by version."""

TOO_MANY_DIGITS = 309
"""Number of digits of the smallest integer that is larger than any float."""


class FileError(MlivrError):
    """A file cannot be written."""


def plain_file(path: str | Path) -> Path | None:
    """Return the file that is made or replaced where a path is written, at the end of its links.

    None stands for a device or a pipe, which is written to. Raises an `OSError` for a folder.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir() or not os.path.basename(path):
        raise IsADirectoryError("it is a folder; give the name of a file")
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return target
    # The standard output may be a file that has no name any more.
    is_named = target.exists() and os.path.samefile(path, target)
    return target if stat.S_ISREG(mode) and is_named else None


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write a file by renaming a finished temporary one, so that no half-written file is ever seen.

    The content is text, which is written in UTF-8, or bytes. Links stay, and the file at their end
    is replaced, with its permissions; devices and pipes are written to. Inside `written_together`
    all this happens at the end of the block. Raises a `FileError` if the file cannot be written.
    """
    path = FileName().read(path, FieldPath("path", FileError))
    with written_together() as files, _reasons_told(path):
        data = content.encode() if isinstance(content, str) else content
        files.append(_PendingFile.prepared(path, plain_file(path), data))


@contextmanager
def written_together() -> Iterator[list[_PendingFile]]:
    """Write the files of a block at its end: all of them, or none if it fails or one cannot be.

    Each is complete under a temporary name before the first one gets its own. It holds for this
    thread alone; a block within another one belongs to that.
    """
    outer = _pending.get()
    if outer is not None:
        yield outer
        return
    files: list[_PendingFile] = []
    token = _pending.set(files)
    try:
        yield files
        for one in files:
            one.write_through()
        for one in files:
            one.replace(keeps_old=len(files) > 1)
    except BaseException:
        for one in reversed(files):
            one.restore()
        raise
    finally:
        _pending.reset(token)
        for one in files:
            one.remove_temporary()


@dataclass
class _PendingFile:
    """A file that is written at the end of a block."""

    path: str
    """Its name as it was given."""
    target: Path | None
    """The plain file that it replaces, or None for a device or a pipe."""
    content: bytes
    temporary: Path
    """The finished file, which will be renamed."""
    may_be_restored: bool = False
    """Whether renaming has begun and what is replaced, if anything, has another name."""

    @classmethod
    def prepared(cls, path: str, target: Path | None, content: bytes) -> _PendingFile:
        """Write the temporary file, which gets the permissions of the one that it will replace."""
        place = target or Path(path)
        name = f".{place.name}.{secrets.token_hex(8)}"
        made = cls(path, target, content, place.with_name(name))
        if target is None:
            return made
        try:
            known = target.stat() if target.exists() else None
            # For a new file the system takes away what the process' umask says.
            opener = partial(os.open, mode=0o666 if known is None else 0o600)
            with open(made.temporary, "xb", opener=opener) as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            if known is not None:
                with suppress(OSError, AttributeError):  # another user's file; Windows
                    os.chown(made.temporary, known.st_uid, known.st_gid)
                os.chmod(made.temporary, stat.S_IMODE(known.st_mode))
        except BaseException:
            made.remove_temporary()
            raise
        return made

    @property
    def old(self) -> Path:
        """Another name of the file that is replaced, until all files are in their places."""
        return self.temporary.with_name(f"{self.temporary.name}.old")

    def write_through(self) -> None:
        """Write the content to a device or a pipe."""
        if self.target is None:
            with _reasons_told(self.path), open(os.open(self.path, os.O_WRONLY), "wb") as stream:
                stream.write(self.content)

    def replace(self, keeps_old: bool) -> None:
        """Rename the temporary file."""
        if self.target is None:
            return
        with _reasons_told(self.path):
            if keeps_old and self.target.exists():
                try:
                    os.link(self.target, self.old)
                except OSError:  # a file system without hard links
                    shutil.copy2(self.target, self.old)
            self.may_be_restored = keeps_old
            os.replace(self.temporary, self.target)
            _sync_folder(self.target.parent)

    def restore(self) -> None:
        """Put back what was replaced."""
        if self.target is None or not self.may_be_restored or self.temporary.exists():
            return
        with suppress(OSError):
            if self.old.exists():
                os.replace(self.old, self.target)
            else:
                self.target.unlink()

    def remove_temporary(self) -> None:
        """Remove the files that nothing needs any more."""
        with suppress(OSError):
            self.temporary.unlink(missing_ok=True)
            self.old.unlink(missing_ok=True)


_pending: ContextVar[list[_PendingFile] | None] = ContextVar("pending", default=None)
"""Files of the block that is under way."""


@contextmanager
def _reasons_told(path: str) -> Iterator[None]:
    """Turn what the system says about a file into a `FileError`."""
    try:
        yield
    except (OSError, ValueError) as error:  # for example a null character in the name
        raise FileError(f"cannot write {path_shown(path)}: {reason(error)}") from None


def reason(error: OSError | ValueError) -> str:
    """Return the message of an error of the system without its number and file name."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def make_folder(folder: str | Path) -> Path:
    """Make a folder and its missing parents.

    Raises a `FileError` if it cannot be made.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise FileError(f"cannot create folder {str(folder)!r}: {reason(error)}") from None
    return path


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
        if _is_deep(data):
            raise RecursionError
    except UnicodeDecodeError:
        why = "it is not UTF-8 text"
    except RecursionError:
        why = "it is nested too deeply"
    except json.JSONDecodeError as fault:
        why = f"it is not JSON: {fault}"
    except (OSError, ValueError) as fault:
        why = reason(fault)
    else:
        return data
    raise error(f"cannot read {kind} {path_shown(path)}: {why}")


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


def _is_deep(data: dict[str, Any]) -> bool:
    """Return whether more than `DEEPEST` objects and lists of JSON data are within each other."""
    level: list[Any] = [data]
    for _ in range(DEEPEST):
        inner = (one.values() if isinstance(one, dict) else one for one in level)
        level = [entry for entries in inner for entry in entries if isinstance(entry, dict | list)]
        if not level:
            return False
    return True


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
