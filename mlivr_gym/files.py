"""Files are written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from mlivr_gym.errors import MlivrError


class FileError(MlivrError):
    """A file cannot be written."""


def write_whole(path: str | Path, content: str | bytes) -> None:
    """Write a file by renaming a finished temporary one, so that no half-written file is ever seen.

    Raises:
        FileError: If the file cannot be written.
    """
    target = Path(path)
    name = None
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        with os.fdopen(handle, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, 0o666 & ~umask)
        os.replace(name, target)
    except OSError as error:
        if name is not None:
            Path(name).unlink(missing_ok=True)
        raise FileError(f"cannot write {str(path)!r}: {error.strerror or error}") from None
