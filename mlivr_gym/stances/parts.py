"""What is done of a table that is being built, kept until all of it is.

A build that was stopped goes on from there. Each part is a file that is written whole, and of two
builds of one table both write the same, so either takes what the other has done.
"""

from __future__ import annotations

import io
import logging
import shutil
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled.cache import cache_folder, source_digest
from mlivr_gym.files import FileError, write_whole
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_files import key_of

Arrays = Sequence[NDArray[Any]]


class Parts:
    """The parts of a table that are done, each of some arrays."""

    def __init__(self, folder: Path | None) -> None:
        """Parts in a folder of their own; None: nothing is kept."""
        self.folder = folder

    @classmethod
    def of(cls, graph: StanceGraph, source: str) -> Parts:
        """Those of the table of a graph in the cache folder, by the source that works it out."""
        folder, digest = cache_folder(), source_digest(Path(source))
        return cls(None if folder is None else folder / f"parts-{key_of(graph)}-{digest}")

    def get(self, name: str, work: Callable[[], Arrays]) -> Arrays:
        """The arrays of a part: those that are kept, else what `work` finds, which then is kept."""
        found = self._read(name)
        if found is None:
            found = work()
            self._write(name, found)
        return found

    def count(self) -> int:
        """Number of parts that are kept."""
        return len([] if self.folder is None else list(self.folder.glob("*.npz")))

    def remove(self) -> None:
        """Remove all parts; what another build writes at the same time it removes itself."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)

    def _read(self, name: str) -> Arrays | None:
        """A part that is kept; None if there is none, or a file that was cut off or altered."""
        if self.folder is None:
            return None
        try:
            # What is read is compared with the checksums in the archive.
            with (self.folder / f"{name}.npz").open("rb") as stream, np.load(stream) as found:
                return list(found.values())
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None

    def _write(self, name: str, arrays: Arrays) -> None:
        """Keep a part; the first that cannot be is told, and no more are."""
        if self.folder is None:
            return
        buffer = io.BytesIO()
        np.savez(buffer, *arrays)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_whole(self.folder / f"{name}.npz", buffer.getvalue())
        except (OSError, FileError) as error:
            text = "parts of the table are not kept, so what is stopped begins anew: %s"
            logging.getLogger(__name__).warning(text, error)
            self.folder = None
