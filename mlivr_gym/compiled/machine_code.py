"""Machine code in the cache folder, which Numba reads and writes.

Numba has no public interface to what it does there. Its private part, the cache of a function that
it compiles, is used in this file alone.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from mlivr_gym.compiled.cache import make_private

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


def guard(compiled: Any) -> None:
    """Let a function, a dispatcher of Numba, store and read its machine code safely."""
    compiled._cache = _GuardedCache(compiled._cache)


def is_stored(compiled: Any) -> bool:
    """Return whether the cache folder has machine code of a function for any arguments."""
    folder, name = compiled.stats.cache_path, compiled.py_func.__qualname__
    return folder is not None and any(Path(folder).glob(f"*.{name}-*.nbi"))


def time_interpreted(compiled: Any) -> float:
    """Return how long a function was interpreted in earlier processes [s], see `kernels`."""
    path = _time_file(compiled)
    try:
        seconds = float(path.read_text(encoding="ascii")) if path else 0.0
    except (OSError, ValueError):
        return 0.0
    return seconds if seconds > 0.0 else 0.0


def store_time_interpreted(compiled: Any, seconds: float) -> None:
    """Store that time for later processes, if it can be stored."""
    path = _time_file(compiled)
    if path is not None:
        with suppress(OSError):
            make_private(path.parent)
            path.write_text(f"{seconds:.3f}", encoding="ascii")


def _time_file(compiled: Any) -> Path | None:
    """Return the file of that time, beside the machine code; None if none is stored."""
    folder = compiled.stats.cache_path
    return folder and Path(folder) / f"{compiled.py_func.__qualname__}.seconds"


class _GuardedCache:
    """Cache of a compiled function whose files may be written by several processes, or damaged."""

    def __init__(self, cache: Any) -> None:
        """Take Numba's cache of the function, which may be empty."""
        self._cache = cache

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of Numba's cache."""
        return getattr(self._cache, name)

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Store a compiled function, one process after the other.

        Numba reads the list of what is stored, adds to it and writes it back.
        """
        with _locked(self._cache.cache_path):
            self._cache.save_overload(signature, compiled)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Return the function compiled for a signature, or None if it is not stored.

        What is stored of a function whose files are damaged is given up.
        """
        try:
            return self._cache.load_overload(signature, target)
        except Exception as error:  # an altered file may cause any error
            folder = self._cache.cache_path
            text = "machine code in %s cannot be read: %s; it is compiled again"
            logging.getLogger(__name__).warning(text, folder, error)
            with _locked(folder):
                self._cache.flush()
            return None


@contextmanager
def _locked(folder: str | None) -> Iterator[None]:
    """Run the block while no other process runs one with the same folder."""
    if folder is None or fcntl is None:
        yield
        return
    os.makedirs(folder, exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some network drives have no locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
