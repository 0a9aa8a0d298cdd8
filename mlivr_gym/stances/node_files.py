"""Where tables of nodes are kept: small files to pass on, and unpacked ones in the cache folder."""

from __future__ import annotations

import io
import logging
import lzma
from collections import OrderedDict
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.cache import cache_folder
from mlivr_gym.compiled.cached_files import mark_used
from mlivr_gym.compiled.limb_masks import unpacked
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.files import write_whole
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.node_pairs import EdgeSet, gather, spread
from mlivr_gym.stances.node_table import (
    RESOLUTION,
    Nodes,
    NodeTable,
    NodeTableError,
    table_of,
)
from mlivr_gym.stances.parts import keep_table
from mlivr_gym.stances.stance_sets import key_of
from mlivr_gym.stances.table_heads import difference, head_of
from mlivr_gym.world.grasp_map import GraspMap

FORMAT = 5
"""Format of the files."""

SHIPPED = ("mlivr3", "mlivr4")
"""Robots whose tables on the JEM ship with the package."""

ALIGNED = 64
"""What the place of an array in an unpacked file is a multiple of [bytes], for compiled code."""

KEPT = 2
"""Tables that are kept in memory."""

_kept: OrderedDict[str, NodeTable] = OrderedDict()
"""The tables of the graphs used last."""


def node_table(graph: LazyGraph) -> NodeTable | None:
    """The table that was built for a graph, given as a small file or shipped; None without one.

    The graph has it from then on. One that cannot be read is passed over with a warning.
    """
    key = key_of(graph)
    found = _kept.get(key) or _found(graph, key)
    if found is not None:
        remember(found, graph)
    return found


def remember(table: NodeTable, graph: LazyGraph) -> None:
    """Give a graph its table, and keep it in memory for others of the same kind."""
    _kept[key_of(graph)] = graph.table = table
    if len(_kept) > KEPT:
        _kept.popitem(last=False)


def write_table(table: NodeTable, graph: LazyGraph, path: str | Path) -> None:
    """Write a table as small as it gets.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    limbs, away = table.limbs, table.base_position - _centroids(graph.grasp_map, table.points)
    masks = [
        unpacked(one, limbs).astype(np.uint16) for one in (table.masks, table.released, table.folds)
    ]
    steps = gather(table)
    arrays = [
        np.array([str(FORMAT), key_of(graph), *head_of(graph, FORMAT)[1:]]),
        np.diff(table.points.astype(np.int32), axis=0, prepend=0).astype(np.int16).T.copy(),
        *_coded(np.rint(away / RESOLUTION).astype(np.int64)),
        *_coded(np.stack(masks, axis=2).reshape(-1, 3)),
        table.tried,
        np.array([len(steps.joined), len(steps.loses_branches)]),
        np.packbits(steps.joined),
        np.packbits(steps.loses_branches),
        *_coded(steps.lost),
    ]
    stream = io.BytesIO()
    for one in arrays:
        np.save(stream, one)
    write_whole(path, lzma.compress(stream.getvalue()))


def _coded(rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.uint32]]:
    """The different ones of some rows, and which of them each is: there are few."""
    different, which = np.unique(rows, axis=0, return_inverse=True)
    return different, which.reshape(-1).astype(np.uint32)


def read_table(path: str | Path, graph: LazyGraph) -> NodeTable | None:
    """The table in a file; None if it is one of another graph.

    Raises
    ------
    NodeTableError
        If it is none of this format.
    """
    try:
        with lzma.open(path) as stream:
            head = _arrays(stream, 1)[0].tolist()
            if head[0] != str(FORMAT):
                raise ValueError
            if head[1] != key_of(graph):
                return None
            apart, places, place, threes, three, tried = _arrays(stream, 6)
            counts, *steps, losses, lost = _arrays(stream, 5)
        points = np.cumsum(apart.T, axis=0, dtype=np.int64)
        base = _centroids(graph.grasp_map, points) + places[place] * RESOLUTION
        masks, released, folds = threes[three].reshape(*points.shape, 3).transpose(2, 0, 1)
        table = table_of(Nodes(points, base, masks, released, folds, tried))
        joined, loses_branches = (
            np.unpackbits(one, count=count).view(np.bool_)
            for one, count in zip(steps, counts.tolist(), strict=True)
        )
        return spread(table, EdgeSet(joined, loses_branches, losses[lost]))
    except (OSError, ValueError, TypeError, IndexError, EOFError, lzma.LZMAError):
        raise NodeTableError(f"{str(path)!r} is no table of nodes of format {FORMAT}") from None


def _found(graph: LazyGraph, key: str) -> NodeTable | None:
    """The table of a graph: as it was unpacked, or a small file, unpacked for the next time.

    To put the nodes of a small file together takes seconds.
    """
    log, path = logging.getLogger(__name__), unpacked_path(key)
    if path is None:
        return None
    if path.is_file():
        try:
            head, *arrays = _mapped(path, 1 + len(NodeTable._fields))
            another = difference(head.tolist(), graph, FORMAT)
            if not another:
                mark_used(path)
                return NodeTable(*arrays)
            log.warning("%r is a table of nodes %s: it is passed over", str(path), another)
        except (OSError, ValueError, TypeError, EOFError):
            log.warning("%r holds no table of nodes: it is passed over", str(path))
    given = path.parent / small_name(key)
    for small in _small_files(graph, given):
        try:
            table = read_table(small, graph)
        except NodeTableError as error:
            log.warning("%s", error)
            continue
        if table is not None:
            keep_table(path, partial(write_unpacked, table, graph))
            return table
        if small == given:
            log.warning("%r is a table of nodes of another graph: it is passed over", str(small))
    return None


def _small_files(graph: LazyGraph, given: Path) -> list[Path]:
    """Small files in which the table of a graph may be: one that was given, and what ships."""
    name = graph.robot.name
    return [given] * given.is_file() + [asset_path(f"nodes-{name}.xz")] * (name in SHIPPED)


def small_name(key: str) -> str:
    """Name under which a small file is found in the cache folder."""
    return f"nodes-{key}.xz"


def unpacked_path(key: str) -> Path | None:
    """Where the table of a graph lies in the cache folder, None without one."""
    folder = cache_folder()
    return None if folder is None else folder / f"nodes-{key}-{FORMAT}.npy"


def write_unpacked(table: NodeTable, graph: LazyGraph, path: Path) -> None:
    """Write a table as it is read soonest.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    stream = io.BytesIO()
    for one in (np.array(head_of(graph, FORMAT)), *table):
        stream.write(bytes(-stream.tell() % ALIGNED))
        np.save(stream, one)
    write_whole(path, stream.getvalue())


def _mapped(path: Path, count: int) -> list[NDArray[Any]]:
    """Arrays of a file that `write_unpacked` wrote; what is not looked at is not read."""
    whole, found = np.memmap(path, np.uint8, mode="c"), []
    with path.open("rb") as stream:
        for _ in range(count):
            stream.seek(-stream.tell() % ALIGNED, io.SEEK_CUR)
            np.lib.format.read_magic(stream)
            shape, columns, kind = np.lib.format.read_array_header_1_0(stream)
            begin = stream.tell()
            end = begin + int(np.prod(shape)) * kind.itemsize
            one = whole[begin:end].view(kind).reshape(shape, order="F" if columns else "C")
            found.append(np.asarray(one))
            stream.seek(end)
    return found


def _arrays(stream: IO[bytes], count: int) -> list[NDArray[Any]]:
    """Arrays that were saved one after the other."""
    return [np.load(stream, allow_pickle=False) for _ in range(count)]


def _centroids(grasp_map: GraspMap, points: IntArray | NDArray[np.uint16]) -> Array:
    """Centroids of the points of stances, shape (n, 3) [m]."""
    centroids: Array = grasp_map.positions[points].mean(axis=1)
    return centroids
