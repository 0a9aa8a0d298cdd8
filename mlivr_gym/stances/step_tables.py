"""Every step of a two-limb stance graph in plain arrays, for environments and experts.

`step_tables(graph)` checks every step of the graph, once for a map: the entries go to the user's
cache directory, from where later runs read them.
"""

from __future__ import annotations

import hashlib
import io
import logging
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym._version import __version__
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.compiled.bit_sets import ALL, BRANCHES
from mlivr_gym.compiled.cache import cache_folder, source_digest
from mlivr_gym.errors import SettingError
from mlivr_gym.files import FileError, write_whole
from mlivr_gym.settings import GRAPH_RULES
from mlivr_gym.stances import pair_graph
from mlivr_gym.stances.pair_graph import PairGraph, fill_rows
from mlivr_gym.stances.pair_steps import gather_steps
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_steps import steps_of_state
from mlivr_gym.transitions.rule import kept_on_edge
from mlivr_gym.transitions.state import State, Successors

FORMAT = 3
"""Version of the file format; the files of version 0.1.0 have none."""


class StepTables(NamedTuple):
    """The steps between n stances on m points; limb j of a stance moves while limb 1 - j holds.

    The steps of stance s that move limb j are the entries from `start[2 s + j]` to `start[2 s + j +
    1]`, in the order of the points they lead to.
    """

    points: NDArray[np.int32]
    """Point that each limb of a stance holds, shape (n, 2)."""
    base_in_world: Array
    """Base positions [m], shape (n, 3)."""
    masks: NDArray[np.int32]
    """Branches and flips each limb of a stance may hold on, shape (n, 2)."""
    releasable: NDArray[np.int32]
    """Those on which it can be released, and may be once it has grasped, shape (n, 2)."""
    start: IntArray
    """Where the steps begin, shape (2 n + 1,)."""
    after: NDArray[np.int32]
    """Stance that a step leads to, shape (e,)."""
    kept: NDArray[np.int32]
    """Branches and flips that the limb that holds can keep on a step, never 0, shape (e,)."""

    def masks_after(self, step: int, limb: int, masks: tuple[int, ...]) -> tuple[int, int]:
        """Masks after a step that leaves a state, of limb 0 and of limb 1.

        Args:
            step: Index of the step.
            limb: The limb that moves.
            masks: Those before.
        """
        kept = int(kept_on_edge(masks[1 - limb], int(self.kept[step])))
        grasped = int(self.releasable[self.after[step], limb])
        return (grasped, kept) if limb == 0 else (kept, grasped)

    def successors(self, s: int, masks: tuple[int, ...]) -> Successors:
        """The steps that leave a state of stance `s`, as `PairGraph.successors` gives them."""
        most = int(self.start[2 * s + 2] - self.start[2 * s])
        steps, kept = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
        first, count = steps_of_state(s, (masks[0], masks[1]), self, steps, kept)
        after, kept = self.after[steps[:count]].astype(np.int64), kept[:count]
        moving = np.zeros(count, dtype=np.int64)
        moving[first:] = 1
        both = self.releasable[after].astype(np.int64)
        both[np.arange(count), 1 - moving] = kept
        return Successors(
            moving, self.points[after, moving].astype(np.int64), self.base_in_world[after], both
        )


def step_tables(
    graph: StanceGraph, progress: Callable[[int, int], None] | None = None
) -> StepTables:
    """The steps of a two-limb graph among the obstacles and occupied points that there are now.

    Every step is checked, or the answers of an earlier run are read.

    Args:
        graph: The stance graph.
        progress: Called with rows done and rows in all while steps are checked.

    Raises:
        SettingError: If the robot has more than two limbs.
    """
    if not isinstance(graph, PairGraph):
        raise SettingError(
            f"exact tables need two limbs; robot {graph.robot.name!r} has {graph.limbs}"
        )
    check = graph.settings.transitions
    if check and not graph.complete:
        path = None if graph.obstacles or graph.occupied else cache_file(graph)
        if path is None or not _read(graph, path):
            fill_rows(graph, progress)
            if path is not None:
                _write(graph, path)
    start = np.zeros(2 * len(graph) + 1, dtype=np.int64)
    nothing = np.zeros(0, dtype=np.int32)
    gather_steps(graph.steps, False, start, nothing, nothing)
    np.cumsum(start, out=start)
    after, kept = np.empty(start[-1], dtype=np.int32), np.empty(start[-1], dtype=np.int32)
    gather_steps(graph.steps, True, start, after, kept)
    released = graph.releasable if check else graph.mask
    masks, releasable = (mask.astype(np.int32) for mask in (graph.mask, released))
    return StepTables(
        graph.points.astype(np.int32), graph.base_in_world, masks, releasable, start, after, kept
    )


def without_points(tables: StepTables, occupied: BoolArray) -> StepTables:
    """The tables of the same map with some points not to be grasped; stances keep their indices.

    Args:
        tables: The steps on all points.
        occupied: Which points may not be grasped, shape (m,).
    """
    gone: BoolArray = np.any(occupied[tables.points], axis=1)
    steps = np.diff(tables.start)
    keep = ~np.repeat(np.repeat(gone, 2), steps) & ~gone[tables.after]
    start = np.concatenate([[0], np.cumsum(keep)])[tables.start]
    masks, releasable = (
        np.where(gone[:, None], 0, mask).astype(np.int32)
        for mask in (tables.masks, tables.releasable)
    )
    return tables._replace(
        masks=masks,
        releasable=releasable,
        start=start,
        after=tables.after[keep],
        kept=tables.kept[keep],
    )


def state_of(tables: StepTables, s: int, masks: NDArray[np.integer]) -> State:
    """The state of a stance index and its masks."""
    a, b = tables.points[s].tolist()
    return State((a, b), (int(masks[0]), int(masks[1])))


def cache_file(graph: PairGraph) -> Path | None:
    """The file of a graph, named after map, robot, settings and the code that checks steps."""
    folder = cache_folder()
    if folder is None:
        return None
    digest = hashlib.sha256(__version__.encode())
    digest.update(graph.grasp_map.fingerprint.encode() + graph.robot.fingerprint.encode())
    digest.update(repr(sorted(asdict(graph.settings).items())).encode())
    digest.update(source_digest(Path(pair_graph.__file__)).encode())
    return folder / f"steps-{digest.hexdigest()[:20]}.npz"


def _write(graph: PairGraph, path: Path) -> None:
    """Keep a filled graph; a cache that cannot be written is no error."""
    steps, buffer = graph.steps, io.BytesIO()
    np.savez_compressed(
        buffer,
        format=FORMAT,
        rules=GRAPH_RULES,
        points=steps.points,
        edges=steps.edges,
        mask=steps.mask,
        released=steps.released,
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, buffer.getvalue())
    except (OSError, FileError):
        return


def _looked_up_safely(found: dict[str, Any], folds: int) -> bool:
    """Whether all in a file by which compiled code looks things up is what that can be."""
    edges, released = found["edges"], found["released"]
    bounds = (
        (edges["fold_on_line"], -1, folds), (edges["fold_on_arc"], -1, folds),
        (edges["pair"], -1, BRANCHES * BRANCHES), (released["root"], 0, folds),
        (released["via"], 0, folds), (released["branches"], 0, ALL + 1),
        (found["mask"], 0, ALL + 1),
    )  # fmt: skip
    return all(bool(((low <= a) & (a < end)).all()) for a, low, end in bounds)


def _read(graph: PairGraph, path: Path) -> bool:
    """Fill a graph from the cache, with a warning if the file is old; False if none can be used."""
    steps = graph.steps
    into = {"edges": steps.edges, "mask": steps.mask, "released": steps.released}
    try:
        # np.load does not close a file that is no archive.
        with path.open("rb") as stream, np.load(stream) as data:
            made = tuple(int(data[name]) if name in data else 1 for name in ("format", "rules"))
            if made != (FORMAT, GRAPH_RULES):
                logging.getLogger(__name__).warning(
                    "step tables %s are of format %d and rules %d, this version needs "
                    "format %d and rules %d: they are worked out anew",
                    path,
                    *made,
                    FORMAT,
                    GRAPH_RULES,
                )
                return False
            found = {name: data[name] for name in (*into, "points")}
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        return False
    if not np.array_equal(found["points"], graph.points) or any(
        found[k].shape != a.shape
        or found[k].dtype.itemsize != a.dtype.itemsize
        or found[k].dtype.names != a.dtype.names
        for k, a in into.items()
    ):
        return False
    if not _looked_up_safely(found, len(graph.robot.folds)):
        return False
    for name, array in into.items():
        array[:] = found[name]
    graph.complete = True
    return True
