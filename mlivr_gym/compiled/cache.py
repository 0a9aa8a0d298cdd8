"""Where answers and machine code are kept between runs, keyed by the sources they depend on."""

from __future__ import annotations

import hashlib
import os
import re
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

CACHE_VARIABLE = "MLIVR_GYM_CACHE"
"""Environment variable that names another cache folder; empty: no tables are kept."""

PACKAGE = Path(__file__).parent.parent
"""The package whose imports are followed."""

IMPORT = re.compile(
    r"^(?:from|import) mlivr_gym((?:\.\w+)+)(?: import (\([^)]*\)|.+))?", re.MULTILINE
)
"""An import from the package as a file is loaded: the module, and what is taken from it."""


def cache_folder() -> Path | None:
    """Where tables are kept, or None if they are not: see `CACHE_VARIABLE`."""
    given = os.environ.get(CACHE_VARIABLE)
    return _default_folder() if given is None else Path(given) if given else None


def kernel_folder(source: str) -> Path:
    """Where machine code of the kernels in a source file is kept.

    There is one folder for each state of that file and of those that it imports. It lies where step
    tables are kept, or in the user's cache folder if they are not.
    """
    return kernel_root() / source_digest(Path(source))


def kernel_root() -> Path:
    """The folder in which those folders lie."""
    return (cache_folder() or _default_folder()) / "kernels"


def _default_folder() -> Path:
    return user_cache_path("mlivr-gym", appauthor=False)


@cache
def source_digest(source: Path) -> str:
    """Digest of the contents of a source file and of all files of this package that it imports.

    Where the files lie plays no part.
    """
    contents = sorted(map(_content, _sources(source)))
    return hashlib.sha256(b"".join(contents)).hexdigest()[:16]


@cache
def _content(source: Path) -> bytes:
    """Digest of the content of one file."""
    return hashlib.sha256(source.read_bytes()).digest()


def _sources(source: Path) -> set[Path]:
    """The file and all files of this package that it imports, directly or not."""
    found, pending = {source}, [source]
    while pending:
        fresh = _imported(pending.pop()) - found
        found |= fresh
        pending.extend(fresh)
    return found


@cache
def _imported(source: Path) -> frozenset[Path]:
    """Files of this package that a file imports as it is loaded."""
    found: set[Path] = set()
    for module, names in IMPORT.findall(source.read_text(encoding="utf-8")):
        path = PACKAGE.joinpath(*module[1:].split("."))
        if (file := path.with_suffix(".py")).is_file():
            found.add(file)
            continue
        candidates = [path / "__init__.py"]
        candidates += [path / f"{name}.py" for name in re.findall(r"\w+", names)]
        found.update(candidate for candidate in candidates if candidate.is_file())
    return frozenset(found)
