"""Folders in which tables and machine code are cached, keyed by the sources that they depend on."""

from __future__ import annotations

import hashlib
import os
import re
import stat
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

CACHE_VARIABLE = "MLIVR_GYM_CACHE"
"""Environment variable that names another cache folder; if it is empty, no tables are cached."""

PACKAGE = Path(__file__).parent.parent
"""The package, among whose files imports are followed."""

IMPORT = re.compile(
    r"^(?:from|import) mlivr_gym((?:\.\w+)+)(?: import (\([^)]*\)|.+))?", re.MULTILINE
)
"""An import from the package at module level: the module, and the names imported from it."""

KERNEL = re.compile(r"^@(?:entry|late_entry|kernel|part)$", re.MULTILINE)
"""What the kernels of a file begin with."""

CLASSES = re.compile(r"[(\s]*(?:[A-Z]\w*[a-z]\w*[,\s)]*)+")
"""Imported names all of which are classes or types."""


def cache_folder() -> Path | None:
    """Return the folder of cached tables, or None if none are cached; see `CACHE_VARIABLE`."""
    given = os.environ.get(CACHE_VARIABLE)
    return _default_folder() if given is None else Path(given) if given else None


def kernel_folder(source: str) -> Path:
    """Return the folder in which machine code of the kernels in a source file is cached.

    There is one folder for each state of that file and of the files that it imports. It lies in the
    folder in which tables are cached, or in the user's cache folder if they are not.
    """
    return kernel_root() / kernel_digest(Path(source))


def kernel_root() -> Path:
    """Return the folder that contains all folders of machine code."""
    return (cache_folder() or _default_folder()) / "kernels"


def make_private(folder: Path) -> None:
    """Create a folder, and those above it that are missing, for this user alone.

    Raises an `OSError` if one cannot be created.
    """
    if not folder.is_dir():
        make_private(folder.parent)
        folder.mkdir(mode=0o700, exist_ok=True)


def writable_by_others(folder: Path) -> Path | None:
    """Return the one of a folder and the cache folders above it that other users may change.

    They could have any code executed as machine code. None if there is no such folder.
    """
    if not hasattr(os, "getuid"):  # Windows, where these bits tell nothing
        return None
    root = kernel_root().parent
    for one in (folder, *(above for above in folder.parents if above.is_relative_to(root))):
        state = one.stat()
        # In a folder with the sticky bit, such as /tmp, users replace only what is their own.
        is_sticky = state.st_mode & stat.S_ISVTX and one != folder
        is_open = state.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not is_sticky
        if is_open or state.st_uid not in (0, os.getuid()):
            return one
    return None


def _default_folder() -> Path:
    """Return the user's cache folder for this package."""
    return user_cache_path("mlivr-gym", appauthor=False)


def source_digest(source: Path) -> str:
    """Return a digest of a source file and of all files of this package that it imports.

    It depends on the contents of the files, not on where they lie.
    """
    return _digest(source, False)


def kernel_digest(source: Path) -> str:
    """Return a digest of all files that the machine code of the kernels in a file depends on.

    A file without kernels, of which one with kernels imports classes alone, is none of them: these
    are in annotations, and the compiler knows the types of the records that it is given.
    """
    return _digest(source, True)


@cache
def _digest(source: Path, of_kernels: bool) -> str:
    """Return `kernel_digest` or `source_digest`."""
    found, pending = {source}, [source]
    while pending:
        fresh = _imported(pending.pop(), of_kernels) - found
        found |= fresh
        pending.extend(fresh)
    contents = sorted(hashlib.sha256(_text(path).encode()).digest() for path in found)
    return hashlib.sha256(b"".join(contents)).hexdigest()[:16]


@cache
def _text(source: Path) -> str:
    """Return the content of a file."""
    return source.read_text(encoding="utf-8")


@cache
def _imported(source: Path, of_kernels: bool) -> frozenset[Path]:
    """Return the files of this package that a file imports at module level."""
    modules: set[Path] = set()
    for module, names in IMPORT.findall(_text(source)):
        path = PACKAGE.joinpath(*module[1:].split("."))
        if (file := path.with_suffix(".py")).is_file():
            only_named = of_kernels and CLASSES.fullmatch(names) and not KERNEL.search(_text(file))
            modules.update(() if only_named else (file,))
            continue
        candidates = [path / "__init__.py"]
        candidates += [path / f"{name}.py" for name in re.findall(r"\w+", names)]
        modules.update(candidate for candidate in candidates if candidate.is_file())
    return frozenset(modules)
