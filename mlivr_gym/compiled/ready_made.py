"""Machine code that ships in some wheels, an archive that saves the compilation on first use.

Numba caches machine code for the exact processor on which it was compiled, so its cache cannot be
used on another machine. The archive is compiled for a generic processor. It is used on every
processor that has the same features, with exactly the Python, the Numba and the sources with which
it was made. An entry that the archive has is not copied to the user's cache folder, since reading
the archive takes no longer.

Numba has no public interface to load machine code. Its private parts are used in this file alone:
the cache of a dispatcher, the reconstruction of a compiled function, and in `pack` the index of a
folder. The archive fits one exact version of Numba, so these parts never meet another version.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import os
import pickle
import re
import sysconfig
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

import llvmlite.binding
import numba

from mlivr_gym.compiled.cache import PACKAGE

FIRST_PLAN = PACKAGE / "planners" / "planner.py"
"""Source file on which, with its imports, all kernels of a first plan depend."""

INDEX = re.compile(r"[^.]+\.(.+)-\d+\.py\w+\.nbi")
"""Name of a file in which Numba lists the machine code of a function."""


def archive_path() -> Path:
    """Return the path of the archive for this Python and platform, in the installed package."""
    return PACKAGE / "envs_assets" / f"kernels-{sysconfig.get_config_var('SOABI')}.zip"


def machine() -> dict[str, str]:
    """Return the versions that must be the same for the archive and for this process."""
    return {
        "Numba": numba.__version__,
        "Python": str(sysconfig.get_config_var("SOABI")),
        "platform": llvmlite.binding.get_process_triple(),
    }


@cache
def archive() -> zipfile.ZipFile | str:
    """Return the archive, or the reason why this process cannot use it."""
    here, settings = machine(), vars(numba.config)
    if settings["CPU_NAME"] is not None or settings["CPU_FEATURES"] is not None:
        return "NUMBA_CPU_NAME or NUMBA_CPU_FEATURES requests machine code for another processor"
    try:
        # Read into memory: forked processes would share the position in an open file.
        found = zipfile.ZipFile(io.BytesIO(archive_path().read_bytes()))
        description = json.loads(found.comment)
        made_for, features = description["for"], description["features"]
        differ = [name for name, value in here.items() if made_for[name] != value]
    except FileNotFoundError:
        return f"this installation has none for {here['Python']}"
    except Exception as error:  # an altered file may cause any error
        return _damaged(error)
    has = llvmlite.binding.get_host_cpu_features()
    missing = " ".join(feature for feature in features if not has.get(feature))
    if differ:
        name = differ[0]
        return f"it is for {name} {made_for[name]}, this process has {here[name]}"
    return f"this processor lacks {missing}" if missing else found


def why_compiled(digest: str) -> str:
    """Return why kernels of a first plan must be compiled, empty if the archive has them.

    They are those of sources with a digest, see `cache.kernel_digest`.
    """
    found = archive()
    if isinstance(found, str):
        return found
    return (
        ""
        if json.loads(found.comment)["sources"] == digest
        else "it was compiled from other sources"
    )


def _damaged(error: Exception) -> str:
    """Log that the archive cannot be read, and return the reason."""
    why = f"{archive_path()} cannot be read: {error}"
    logging.getLogger(__name__).warning("%s; its kernels are compiled instead", why)
    return why


def offer(dispatcher: Any, digest: str) -> None:
    """Let a compiled function, a dispatcher of Numba, load its machine code from the archive, too.

    The digest is that of its sources, see `cache.kernel_digest`.
    """
    entry_name = f"{digest}/{dispatcher.py_func.__qualname__}"
    dispatcher._cache = _CacheWithArchive(dispatcher._cache, entry_name)


class _CacheWithArchive:
    """Cache of a compiled function that reads the archive first, then Numba's cache folder.

    Before it reads its folder, Numba imports all that compilation may need, which takes as long as
    loading all functions of a plan from the archive.
    """

    def __init__(self, cache: Any, entry_name: str) -> None:
        """Take Numba's cache of the function, which may be empty, and its name in the archive."""
        self._cache, self._entry_name = cache, entry_name

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
        """Return the function compiled for a signature, or None if neither has it.

        What is stored of a function whose files are damaged is given up.
        """
        payload = _read(member(self._entry_name, signature))
        if payload is None:
            try:
                return self._cache.load_overload(signature, target)
            except Exception as error:  # an altered file may cause any error
                folder = self._cache.cache_path
                text = "machine code in %s cannot be read: %s; it is compiled again"
                logging.getLogger(__name__).warning(text, folder, error)
                with _locked(folder):
                    self._cache.flush()
                return None
        from numba.core.compiler import CompileResult  # as in the archive's version of Numba

        return CompileResult._rebuild(target, *payload)


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


def member(entry_name: str, signature: Any) -> str:
    """Return the name in the archive of a function compiled for a signature."""
    return f"{entry_name}/{hashlib.sha256(str(signature).encode()).hexdigest()[:16]}"


def _read(name: str) -> Any:
    """Return what the archive contains under a name, or None."""
    found = archive()
    if isinstance(found, str) or name not in found.NameToInfo:
        return None
    try:
        return pickle.loads(found.read(name))
    except Exception as error:  # an altered file may cause any error
        _damaged(error)
        return None


def pack(folder: Path, features: Sequence[str], digest: str) -> bytes:
    """Return the content of an archive with the machine code in a folder, see `cache.kernel_root`.

    This Python and Numba cached it there, for a processor with some features and for sources with a
    digest, see `why_compiled`.
    """
    description = {"for": machine(), "features": list(features), "sources": digest}
    contents = {}
    for path in folder.glob("*/*/*.nbi"):
        entry_name = path.parent.parent.name + "/" + INDEX.sub(r"\1", path.name)
        with path.open("rb") as index:
            pickle.load(index)  # the version of Numba
            _, functions = pickle.loads(index.read())
        for (signature, *_), name in functions.items():
            contents[member(entry_name, signature)] = (path.parent / name).read_bytes()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as made:
        made.comment = json.dumps(description).encode()
        for name, content in sorted(contents.items()):
            made.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED, 9)
    return packed.getvalue()
