"""Files of tables: the named arrays of one stance graph in a NumPy archive (`.npz`).

An archive is a zip file, in which each array has a CRC-32 that reading compares. To be shipped, it
is compressed; to be used without being read, its arrays are stored as they are and mapped into
memory: they are compared once, and again when size or time of the file differ. Its head, a JSON
text, names format, graph rules, robot, map and settings, so that no other graph uses the table.
"""

from __future__ import annotations

import io
import json
import logging
import os
import struct
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.compiled.cache import cache_folder, make_private
from mlivr_gym.compiled.kernels import threads
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError
from mlivr_gym.files import FileError, write_whole
from mlivr_gym.settings import GRAPH_RULES
from mlivr_gym.stances.checked_steps import CheckedSteps
from mlivr_gym.stances.graph_table import GraphTable

HEAD = "head.json"
"""Name of the head in the archive."""

ALIGNED = 64
"""Boundary on which the data of each array starts in the file [bytes], for compiled code."""

PADDING = 0xD935
"""Identifier of the zip field that fills the space up to there, as in Android packages."""

LOCAL_HEADER = struct.Struct("<26xHH")
"""What zip writes before a member: it ends with the lengths of its name and its fields."""

HEADER = 1 << 16
"""More bytes than the header of an array has."""

SIZES_FIELD = 20
"""Length of the zip field with the sizes of a member [bytes]."""

LARGE = 100e6
"""Size from which on a file is told when it is stored in the cache folder [bytes]."""

CHECKED = ".checked"
"""End of the name of the file that says with which size and time a mapped file was checked."""

Arrays = Mapping[str, NDArray[Any]]

MOST_IN_MEMORY = 4
"""Number of tables that stay in memory."""

_memory: OrderedDict[str, tuple[Path | None, GraphTable]] = OrderedDict()
"""Tables used last and their files, if they are stored, by the names of the files."""


class TableError(MlivrError):
    """A table of a stance graph cannot be built, or a file holds none of the graph."""


@dataclass(frozen=True)
class TableFiles:
    """How tables are named, written, found and read."""

    format: int
    """Version of the format of the files."""
    encode: Callable[[CheckedSteps, GraphTable], Arrays]
    """Returns a table in the arrays of a compressed file."""
    decode: Callable[[CheckedSteps, Arrays], GraphTable]
    """Checks such arrays and returns the table; raises any error if they are damaged."""
    to_mapped: Callable[[GraphTable], Arrays]
    """Returns a table in the arrays of a file that is mapped."""
    of_mapped: Callable[[Arrays], GraphTable]
    """Checks such arrays and returns the table."""

    def name(self, graph: CheckedSteps) -> str:
        """Return the name of the compressed file of a graph."""
        return f"table-{key_of(graph)}.npz"

    def cached(self, graph: CheckedSteps) -> Path | None:
        """Return where the cache folder has the table of a graph; None without such a folder."""
        folder = cache_folder()
        return None if folder is None else folder / f"table-{key_of(graph)}-unpacked.npz"

    def find(
        self, graph: CheckedSteps, *, warn: bool = True
    ) -> tuple[Path | None, GraphTable] | None:
        """Return the table of a graph and its file, which ships or lies in the cache folder.

        It is unpacked into the cache folder first. A file that cannot be used is skipped with a
        warning. A table that could not be stored has no file.
        """
        name, cached = self.name(graph), self.cached(graph)
        known = _memory.get(name)
        if known is not None:
            return known
        files = [asset_path(name)]
        if cached is not None:
            files = [cached, *files, cached.with_name(name)]
        for path in filter(Path.is_file, files):
            try:
                table = self.read(graph, path)
            except TableError as error:
                if warn:
                    logging.getLogger(__name__).warning("%s; the file is not used", error)
                continue
            if path != cached:
                path = self.cache(graph, table) or path
            return self.remember(graph, path, table)
        return None

    def remember(
        self, graph: CheckedSteps, path: Path | None, table: GraphTable
    ) -> tuple[Path | None, GraphTable]:
        """Keep a table in memory, for all graphs of its kind, and return it and its file."""
        _memory[self.name(graph)] = path, table
        if len(_memory) > MOST_IN_MEMORY:
            _memory.popitem(last=False)
        return path, table

    def read(self, graph: CheckedSteps, path: Path) -> GraphTable:
        """Return the table in a file.

        Raises a `TableError` if the file is damaged, or of another graph or format.
        """
        try:
            if path == self.cached(graph):
                return self.of_mapped(self.arrays(graph, path, mapped=True))
            return self.decode(graph, self.arrays(graph, path))
        except TableError:
            raise
        except Exception:  # NumPy and zip raise errors of many kinds on altered files
            raise TableError(
                f"table file {str(path)!r} is damaged, or not of format {self.format}"
            ) from None

    def write(self, graph: CheckedSteps, table: GraphTable, path: Path) -> None:
        """Write a compressed file.

        Raises a `FileError` if the file cannot be written.
        """
        write_whole(path, self.pack(graph, self.encode(graph, table), zipfile.ZIP_LZMA))

    def cache(self, graph: CheckedSteps, table: GraphTable) -> Path | None:
        """Write a table into the cache folder and return its file; None, with a warning, if not."""
        path = self.cached(graph)
        if path is None:
            return None
        try:
            make_private(path.parent)
            content = self.pack(graph, self.to_mapped(table), zipfile.ZIP_STORED)
            write_whole(path, content)
            if len(content) > LARGE:
                text = "stored %s, %.0f MB"
                logging.getLogger(__name__).warning(text, path, len(content) / 1e6)
        except (OSError, FileError) as error:
            logging.getLogger(__name__).warning("the table is not stored: %s", error)
            return None
        return path

    def pack(self, graph: CheckedSteps, arrays: Arrays, compression: int) -> bytes:
        """Return an archive of arrays of a graph."""
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", compression) as archive:
            archive.writestr(zipfile.ZipInfo(HEAD), json.dumps(self.head(graph)))
            for name, array in arrays.items():
                info = zipfile.ZipInfo(f"{name}.npy")
                info.compress_type = compression
                before = LOCAL_HEADER.size + len(info.filename) + SIZES_FIELD + 4
                space = -(buffer.tell() + before) % ALIGNED
                info.extra = struct.pack("<HH", PADDING, space) + bytes(space)
                with archive.open(info, "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, array, allow_pickle=False)
        return buffer.getvalue()

    def arrays(self, graph: CheckedSteps, path: Path, *, mapped: bool = False) -> Arrays:
        """Return the arrays of a graph in an archive, which cannot be written to.

        They are decompressed while others are used already. If they are mapped, the archive has to
        be without compression. Only the pages that are used are then read, if the file was checked
        before; they can be changed in memory. Raises a `TableError` if they are of another graph,
        and any error if the file is damaged, which an array may also do when it is used.
        """
        with path.open("rb") as stream:
            whole = np.memmap(stream, np.uint8, mode="c") if mapped else None
            archive = zipfile.ZipFile(stream if mapped else io.BytesIO(stream.read()))
            if mapped:
                _check_once(path, stream, archive)
            check_head(path, json.loads(archive.read(HEAD)), self.head(graph))
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()[1:]}
            if whole is None:
                submit = threads().submit
                return _InThreads(
                    {name: submit(_read, archive, info) for name, info in members.items()}
                )
            arrays = {}
            for name, info in members.items():
                stream.seek(info.header_offset)
                lengths = LOCAL_HEADER.unpack(stream.read(LOCAL_HEADER.size))
                start = stream.seek(sum(lengths), io.SEEK_CUR)
                arrays[name] = _array(whole[start : start + info.file_size])
        return arrays

    def head(self, graph: CheckedSteps) -> dict[str, Any]:
        """Return the head of the files of a graph."""
        return {
            "format": self.format,
            "rules": GRAPH_RULES,
            "robot": graph.robot.fingerprint,
            "map": graph.grasp_map.fingerprint,
            "settings": json.loads(json.dumps(asdict(graph.settings))),
        }


def check_head(path: Path, head: dict[str, Any], expected: dict[str, Any]) -> None:
    """Check that the head of a file is the expected one; the `TableError` names the difference."""
    if head == expected:
        return
    for name in ("format", "rules"):
        if head[name] != expected[name]:
            raise TableError(
                f"table file {str(path)!r} has {name} {head[name]}, and this version has {name} "
                f"{expected[name]}"
            )
    others = [f"another {name}" for name in ("robot", "map") if head[name] != expected[name]]
    found, present = head["settings"], expected["settings"]
    names = [name for name in sorted({*found, *present}) if found.get(name) != present.get(name)]
    if names:
        others.append(f"other settings ({', '.join(names)})")
    if not others:
        raise ValueError
    raise TableError(f"table file {str(path)!r} is for {' and '.join(others)}")


def _check_once(path: Path, stream: BinaryIO, archive: zipfile.ZipFile) -> None:
    """Compare the CRC-32s of an archive, unless that was done for its present size and time."""
    state, checked = os.fstat(stream.fileno()), path.with_name(path.name + CHECKED)
    present = f"{state.st_size} {state.st_mtime_ns}".encode()
    with suppress(OSError):
        if checked.read_bytes() == present:
            return
    if archive.testzip() is not None:
        raise ValueError
    with suppress(FileError):  # a folder without permission to write
        write_whole(checked, present)


class _InThreads(Mapping[str, NDArray[Any]]):
    """Arrays that threads work out; one that is asked for is waited for."""

    def __init__(self, arrays: dict[str, Future[NDArray[Any]]]) -> None:
        self._arrays = arrays

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._arrays[name].result()

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)


def _read(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """Return the array in a compressed member of an archive."""
    # Whole, since `read_array` copies it in small pieces.
    return _array(np.frombuffer(archive.read(info), np.uint8))


def _array(data: NDArray[np.uint8]) -> NDArray[Any]:
    """Return the array of which some bytes are the file."""
    head = io.BytesIO(data[:HEADER].tobytes())
    np.lib.format.read_magic(head)
    shape, columns, kind = np.lib.format.read_array_header_1_0(head)
    if kind.hasobject:
        raise ValueError
    values = data[head.tell() :].view(kind)
    return np.asarray(values.reshape(shape, order="F" if columns else "C"))


def check_arrays(*expected: tuple[NDArray[Any], tuple[int, ...], float, float]) -> None:
    """Check shapes of arrays and that values are at least one number and below another."""
    for array, shape, least, end in expected:
        if array.shape != shape or not ((array >= least) & (array < end)).all():
            raise ValueError


def key_of(graph: CheckedSteps) -> str:
    """Return a digest of map, robot, settings and rules of a graph, which names its files."""
    digest = sha256(graph.grasp_map.fingerprint.encode() + graph.robot.fingerprint.encode())
    digest.update(f"{graph.settings!r} {GRAPH_RULES}".encode())
    return digest.hexdigest()[:20]
