"""Parts of a table that is being built, by threads, stored until all are finished.

A build that was stopped continues from there. Each part is a file that is written whole. Two builds
of one table write equal parts, so either uses those of the other.
"""

from __future__ import annotations

import io
import logging
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled.cache import cache_folder, make_private, source_digest
from mlivr_gym.files import FileError, write_whole
from mlivr_gym.stances.checked_steps import CheckedSteps
from mlivr_gym.stances.table_files import key_of

PartArrays = Sequence[NDArray[Any]]

Block = tuple[int, Any]
"""A number, and what a part is computed from."""

Progress = Callable[[float], None]
"""Called with the finished share of the work."""


class Parts:
    """Finished parts of a table, each of some arrays."""

    def __init__(self, folder: Path | None) -> None:
        """Store parts in a folder of their own; None stores nothing."""
        self.folder = folder

    @classmethod
    def of(cls, graph: CheckedSteps, source: str) -> Parts:
        """Return the parts of the table of a graph in the cache folder.

        A digest of the source file that computes them is part of the folder's name.
        """
        folder, digest = cache_folder(), source_digest(Path(source))
        return cls(None if folder is None else folder / f"parts-{key_of(graph)}-{digest}")

    def get(self, name: str, work: Callable[[], PartArrays]) -> PartArrays:
        """Return the stored arrays of a part, or compute them by `work` and store them."""
        found = self._read(name)
        if found is None:
            found = work()
            self._write(name, found)
        return found

    def of_blocks(
        self,
        work: Callable[..., PartArrays],
        blocks: Sequence[Block],
        shared: tuple[Any, ...],
        threads: int,
        progress: Progress | None,
    ) -> list[PartArrays]:
        """Return the arrays that `work` computes from each block and what all blocks share."""

        def found(block: Block) -> PartArrays:
            return self.get(f"{work.__name__}-{block[0]}", partial(work, *block, *shared))

        parts = []
        with ThreadPoolExecutor(threads) as pool:
            for part in pool.map(found, blocks) if threads > 1 else map(found, blocks):
                parts.append(part)
                if progress is not None:
                    progress(len(parts) / len(blocks))
        return parts

    def remove(self) -> None:
        """Remove all parts; another build that writes at the same time removes its own."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)

    def _read(self, name: str) -> PartArrays | None:
        """Return a stored part; None if there is none, or its file is torn or altered."""
        if self.folder is None:
            return None
        try:
            # Reading compares the checksums in the archive.
            with (self.folder / f"{name}.npz").open("rb") as stream, np.load(stream) as found:
                return list(found.values())
        except Exception:  # NumPy and zip raise errors of many kinds
            return None

    def _write(self, name: str, arrays: PartArrays) -> None:
        """Store a part; if that fails, warn once and store no more parts."""
        if self.folder is None:
            return
        buffer = io.BytesIO()
        np.savez(buffer, *arrays)
        try:
            make_private(self.folder)
            write_whole(self.folder / f"{name}.npz", buffer.getvalue())
        except (OSError, FileError) as error:
            text = "parts of the table cannot be stored, so a stopped build will start again: %s"
            logging.getLogger(__name__).warning(text, error)
            self.folder = None
