"""Where complete tables of two limbs are kept: those that ship, and those in the cache folder.

A table has every stance that two limbs can hold on a map and what the check of every step found:
the branches kept, the path of the base and the swing. Its name is a digest of map, robot, settings
and rules; nothing else is ever read for them.
"""

from __future__ import annotations

import io
import logging
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import ALL, BRANCHES
from mlivr_gym.compiled.cache import cache_folder
from mlivr_gym.compiled.cached_files import mark_used
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError
from mlivr_gym.files import write_whole
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.tried_poses import bases_at
from mlivr_gym.stances.pair_steps import PairEdge
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.stance_sets import key_of
from mlivr_gym.stances.table_heads import difference, head_of
from mlivr_gym.transitions.records import ReleaseRecord

FORMAT = 5
"""Version of the file format."""

COUNTS = ("considered", "reachable", "no_departure", "self", "cabin", "handrail")
"""What is counted of pairs of points, see `PairGraph`."""


class PairTableError(MlivrError):
    """A file holds no complete table of two limbs."""


class PairStances(NamedTuple):
    """The n stances of a graph of two limbs."""

    points: IntArray
    """Point of each limb, in lexical order, shape (n, 2)."""
    postures: Postures
    """Their postures."""
    counts: Mapping[str, int]
    """Numbers of `COUNTS`."""
    released: Any = None
    """What can be released, rows of `ReleaseRecord`, shape (n, 2); None where it is not known."""
    edges: Any = None
    """All steps, rows of `PairEdge` in the order of `KnownSteps`; None where they are unknown."""


def known_stances(graph: StanceGraph) -> PairStances | None:
    """The complete table of a graph, from what ships or from the cache folder; None without one.

    A file that cannot be used is passed over with a warning.
    """
    for path in filter(Path.is_file, table_files(graph)):
        try:
            found = read_stances(graph, path)
        except PairTableError as error:
            logging.getLogger(__name__).warning("%s: it is worked out anew", error)
            continue
        if path == kept_file(graph):
            mark_used(path)
        return found
    return None


def table_files(graph: StanceGraph) -> list[Path]:
    """Where the table of a graph may lie: where it ships, and where it is kept if it is built."""
    kept = kept_file(graph)
    return [asset_path(file_name(graph))] + ([] if kept is None else [kept])


def file_name(graph: StanceGraph) -> str:
    """Name of the file with the table of a graph."""
    return f"pairs-{key_of(graph)}.npz"


def kept_file(graph: StanceGraph) -> Path | None:
    """Where the table of a graph is kept if it is built; None where nothing is kept."""
    folder = cache_folder()
    return None if folder is None else folder / file_name(graph)


def write_stances(graph: StanceGraph, stances: PairStances, path: Path) -> None:
    """Write a complete table.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    write_whole(path, content_of(graph, stances))


def content_of(graph: StanceGraph, stances: PairStances) -> bytes:
    """What a file with a table holds."""
    postures, buffer = stances.postures, io.BytesIO()
    w, which = np.unique(np.column_stack([postures.w_m, postures.w_b]), axis=0, return_inverse=True)
    np.savez_compressed(
        buffer,
        head=np.array(head_of(graph, FORMAT)),
        counts=np.array([stances.counts[name] for name in COUNTS]),
        points=stances.points.astype(np.uint16),
        tried=postures.tried.astype(np.int16),
        branch=postures.branch.astype(np.int8),
        mask=postures.mask.astype(np.uint16),
        w=w,
        which=which.reshape(-1).astype(np.int32),
        **(
            {}
            if stances.edges is None
            else {"edges": _bare(stances.edges), "released": _bare(stances.released)}
        ),
    )
    return buffer.getvalue()


def _bare(rows: Any) -> Any:
    """Rows with nothing between their fields: equal tables are equal files."""
    bare = np.zeros(rows.shape, dtype=rows.dtype)
    for name in rows.dtype.names:
        bare[name] = rows[name]
    return bare


def read_stances(graph: StanceGraph, path: Path) -> PairStances:
    """The complete table in a file.

    Raises
    ------
    PairTableError
        If the file holds none, or that of another graph, format or rules.
    """
    try:
        # np.load does not close a file that is no archive.
        with path.open("rb") as stream, np.load(stream) as data:
            found = dict(data.items())
        another = difference(found["head"].tolist(), graph, FORMAT)
        if another:
            raise PairTableError(f"step table {str(path)!r} is {another}")
        return _checked(graph, found)
    except (OSError, ValueError, TypeError, KeyError, IndexError, EOFError,
            zipfile.BadZipFile, zlib.error) as error:  # fmt: skip
        if isinstance(error, PairTableError):
            raise
        raise PairTableError(f"{str(path)!r} holds no step table of format {FORMAT}") from None


def _checked(graph: StanceGraph, found: dict[str, NDArray[Any]]) -> PairStances:
    """A table of arrays from a file, by which compiled code may look things up.

    Raises
    ------
    ValueError
        If something in it is not what it can be; other errors of NumPy too.
    """
    points, n = found["points"].astype(np.int64), len(found["points"])
    branch, mask = (found[name].astype(np.int64) for name in ("branch", "mask"))
    which, w = found["which"], found["w"]
    tried: IntArray = found["tried"].astype(np.int64)
    folds = len(graph.robot.folds)
    bounds: list[tuple[NDArray[Any], int, int]] = [
        (points, 0, len(graph.grasp_map)), (tried, 0, 1 << 12), (branch, 0, BRANCHES),
        (mask, 1, ALL + 1), (which, 0, len(w)),
    ]  # fmt: skip
    edges, released = found.get("edges"), found.get("released")
    if edges is not None and released is not None:
        whole = PairEdge.rows(0).dtype, ReleaseRecord.rows(0).dtype
        if (edges.dtype, released.dtype) != whole:
            raise ValueError
        # A file does not tell that fields are aligned, which makes another type of them.
        edges, released = edges.view(whole[0]), released.view(whole[1])
        bounds += [
            (edges["fold_on_line"], -1, folds), (edges["fold_on_arc"], -1, folds),
            (edges["pair"], -1, BRANCHES * BRANCHES), (released["root"], 0, folds),
            (released["via"], 0, folds), (released["branches"], 0, ALL + 1),
            (released["known"], 1, 2),
        ]  # fmt: skip
        # There is no step from a stance to itself in either of its rows.
        unknown = len(edges) - int((edges["known"] == 1).sum())
        if released.shape != (n, 2) or edges.ndim != 1 or unknown != 2 * n:
            raise ValueError
    shapes = (
        (points, (n, 2)), (tried, (n,)), (branch, (n, 2)), (mask, (n, 2)), (which, (n,)),
        (w, (len(w), 3)),
    )  # fmt: skip
    if any(array.shape != shape for array, shape in shapes):
        raise ValueError
    if not all(((low <= array) & (array < end)).all() for array, low, end in bounds):
        raise ValueError
    figures: Array = w[which]
    position, rotation = bases_at(graph.grasp_map, graph.robot, points, tried)
    none = np.zeros(n, dtype=np.int64)
    postures = Postures(
        position, rotation, figures[:, :2].copy(), figures[:, 2].copy(), branch, mask, tried, none
    )
    counts = dict(zip(COUNTS, found["counts"].tolist(), strict=True))
    return PairStances(points, postures, counts, released, edges)
