"""Ready-made machine code, which ships with the package: an archive that saves compiling.

Numba keeps machine code by the exact processor it was compiled on, so what it keeps serves no other
machine. The archive is compiled for a plain processor, and serves every one that has the features
of that, with the Python, the Numba and the sources that it was made with and no other. An entry
asks for it where the user's folder has nothing. What it is given is not kept there: to read it from
the archive takes no longer.

Numba has no public way to hand it machine code. What is private of it stands in this file alone:
the cache of a dispatcher, how a compiled function is put together again, and in `pack` the index of
a folder. Since the archive is of one exact version of Numba, none of it meets another one.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import pickle
import re
import sysconfig
import zipfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba

from mlivr_gym.compiled.cache import PACKAGE

INDEX = re.compile(r"[^.]+\.(.+)-\d+\.py\w+\.nbi")
"""The name of a file in which Numba lists the machine code of a function."""


def archive_path() -> Path:
    """Where the archive for this Python and platform lies: in the installed package, only."""
    return PACKAGE / "envs_assets" / f"kernels-{sysconfig.get_config_var('SOABI')}.zip"


def machine() -> dict[str, str]:
    """What the archive and this process must have alike."""
    return {
        "Numba": numba.__version__,
        "Python": str(sysconfig.get_config_var("SOABI")),
        "platform": llvmlite.binding.get_process_triple(),
    }


@cache
def archive() -> zipfile.ZipFile | str:
    """The archive, or in a few words why there is none for this process."""
    here, settings = machine(), vars(numba.config)
    if settings["CPU_NAME"] is not None or settings["CPU_FEATURES"] is not None:
        return "NUMBA_CPU_NAME or NUMBA_CPU_FEATURES asks for other machine code"
    try:
        # Read at once: processes that are forked would share the place in an open file.
        found = zipfile.ZipFile(io.BytesIO(archive_path().read_bytes()))
        told = json.loads(found.comment)
        made_for, features = told["for"], told["features"]
        differ = [name for name, value in here.items() if made_for[name] != value]
    except FileNotFoundError:
        return f"there is none for {here['Python']}"
    except Exception as error:  # whatever an altered file leads to
        return _damaged(error)
    has = llvmlite.binding.get_host_cpu_features()
    missing = " ".join(feature for feature in features if not has.get(feature))
    if differ:
        name = differ[0]
        return f"it is for {name} {made_for[name]}, here is {here[name]}"
    return f"this processor has no {missing}" if missing else found


def why_compiled(digest: str) -> str:
    """Why what a first plan needs is not ready-made; empty if it is.

    Parameters
    ----------
    digest
        That of the sources of a first plan, see `cache.source_digest`.
    """
    found = archive()
    if isinstance(found, str):
        return found
    return "" if json.loads(found.comment)["sources"] == digest else "it is of other sources"


def _damaged(error: Exception) -> str:
    """Say that the archive cannot be read."""
    why = f"{archive_path()} cannot be read: {error}"
    logging.getLogger(__name__).warning("%s; what it holds is compiled instead", why)
    return why


def offer(dispatcher: Any, digest: str) -> None:
    """Have a function that Numba compiles look into the archive, too.

    Parameters
    ----------
    dispatcher
        The function.
    digest
        That of its sources, see `cache.source_digest`.
    """
    place = f"{digest}/{dispatcher.py_func.__qualname__}"
    dispatcher._cache = _FolderThenArchive(dispatcher._cache, place)


class _FolderThenArchive:
    """Where a function's machine code is looked for."""

    def __init__(self, kept: Any, place: str) -> None:
        """In Numba's cache of it, which may keep nothing, then at a place in the archive."""
        self._kept, self._place = kept, place

    def __getattr__(self, name: str) -> Any:
        """All else is as in Numba's cache."""
        return getattr(self._kept, name)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The function for a signature, or None."""
        found = self._kept.load_overload(signature, target)
        if found is None and (payload := _read(member(self._place, signature))) is not None:
            from numba.core.compiler import CompileResult  # as the archive's Numba has it

            target.refresh()
            found = CompileResult._rebuild(target, *payload)
        return found


def member(place: str, signature: Any) -> str:
    """Name in the archive of a function with a signature."""
    return f"{place}/{hashlib.sha256(str(signature).encode()).hexdigest()[:16]}"


def _read(name: str) -> Any:
    """What the archive has under a name, or None."""
    found = archive()
    if isinstance(found, str) or name not in found.NameToInfo:
        return None
    try:
        return pickle.loads(found.read(name))
    except Exception as error:  # whatever an altered file leads to
        _damaged(error)
        return None


def pack(folder: Path, features: Sequence[str], digest: str) -> bytes:
    """An archive of the machine code in a folder of kernels.

    Parameters
    ----------
    folder
        Where Python and Numba as they are here kept it, see `cache.kernel_root`.
    features
        What the processor has that it was compiled for.
    digest
        See `why_compiled`.
    """
    told = {"for": machine(), "features": list(features), "sources": digest}
    contents = {}
    for path in folder.glob("*/*/*.nbi"):
        place = path.parent.parent.name + "/" + INDEX.sub(r"\1", path.name)
        with path.open("rb") as index:
            pickle.load(index)  # the version of Numba
            _, functions = pickle.loads(index.read())
        for (signature, *_), name in functions.items():
            contents[member(place, signature)] = (path.parent / name).read_bytes()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as made:
        made.comment = json.dumps(told).encode()
        for name, content in sorted(contents.items()):
            made.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED, 9)
    return packed.getvalue()
