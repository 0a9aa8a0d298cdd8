"""Build the complete table of two limbs."""

from __future__ import annotations

import time
import zlib
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import IntArray
from mlivr_gym.stances.parts import Parts
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_table_file import TWO_LIMB_TABLES
from mlivr_gym.stances.workers import Progress

SAMPLE = 5000
"""Number of steps that are checked to estimate the time of all, if there are as many."""

SIDE = 64
"""Largest number of stances of a row whose steps are in the sample."""


class Estimate(NamedTuple):
    """What building a table takes."""

    candidates: str
    """What is checked, with its number."""
    seconds: float
    """Time on this machine [s]."""
    size: float
    """Size of the file [bytes]."""
    done: int = 0
    """Number of parts that a stopped build has finished; the time is that of all parts."""


def fill_rows(
    graph: TwoLimbGraph, progress: Progress | None = None, parts: Parts | None = None
) -> None:
    """Check every step of a graph once.

    Parameters
    ----------
    graph
        The graph.
    progress
        Called with the finished share of the rows.
    parts
        Stores finished parts until all are; only without obstacles and occupied points.
    """
    if graph.is_complete:
        return
    m, known, parts = len(graph.grasp_map), graph.steps, parts or Parts(None)
    known.releases[...] = parts.get("released", partial(_releases, graph))[0]
    first = np.append(known.offset.ravel(), len(known.edges))
    chunk = max(1, m // 16)
    for support, begin in product(range(2), range(0, m, chunk)):
        end = min(begin + chunk, m)
        edges = known.edges[first[support * m + begin] : first[support * m + end]]
        check = partial(_check_rows, graph, support, range(begin, end), edges)
        edges[...] = parts.get(f"rows-{support}-{begin}", check)[0]
        if progress is not None:
            progress((support * m + end) / (2 * m))
    graph.is_complete = True


def _releases(graph: TwoLimbGraph) -> list[NDArray[Any]]:
    """Compute the branches on which every limb can be released."""
    graph.check_releases(np.indices((len(graph), 2)).reshape(2, -1).T)
    return [graph.steps.releases]


def _check_rows(
    graph: TwoLimbGraph, support: int, points: range, edges: NDArray[Any]
) -> list[NDArray[Any]]:
    """Check the steps of some rows, whose records are `edges`."""
    before, after = np.concatenate([graph.edges_of_row(support, p) for p in points], axis=1)
    graph.check_steps(np.full(len(before), support, dtype=np.int64), before, after)
    return [edges]


def built_two_limb_table(graph: TwoLimbGraph) -> Path | None:
    """Return the file of the complete table of a graph; None if it has to be built.

    A graph that was made before the table was stored has all its steps from then on.
    """
    found = TWO_LIMB_TABLES.find(graph, warn=False)
    if found is None:
        return None
    path, known = found
    if not (graph.is_complete or graph.obstacles or graph.occupied):
        graph.steps.edges[...], graph.steps.releases[...] = known.edges, known.releases
        graph.is_complete = True
    return path


def parts_of_two_limb_table(graph: TwoLimbGraph) -> Parts:
    """Return the finished parts of the table of a graph."""
    return Parts.of(graph, __file__)


def build_two_limb_table(graph: TwoLimbGraph, progress: Progress | None = None) -> Path | None:
    """Build the complete table of two limbs, see `table_build.build_table`."""
    path = built_two_limb_table(graph)
    if path is None:
        parts = parts_of_two_limb_table(graph)
        fill_rows(graph, progress, parts)
        path = TWO_LIMB_TABLES.cache(graph, graph.file_contents())
        if path is not None:
            parts.remove()
    return path


def estimate_two_limb_table(graph: TwoLimbGraph) -> Estimate:
    """Estimate what building the table of a graph takes, from a sample of its steps."""
    candidates = f"{graph.considered:,} pairs of points"
    size: float = len(
        TWO_LIMB_TABLES.content(graph, graph.file_contents()._replace(edges=None, releases=None))
    )
    steps = int((graph.degree * (graph.degree - 1) // 2).sum())
    if graph.is_complete or not steps:
        return Estimate(candidates, 0.0, size)
    support, before, after = _sample(graph)
    graph.check_steps(support[:1], before[:1], after[:1])  # compiles
    stances = np.unique([before, after])
    began = time.perf_counter()
    graph.check_releases(np.stack([np.repeat(stances, 2), np.tile([0, 1], len(stances))], axis=1))
    after_releases = time.perf_counter()
    graph.check_steps(support, before, after)
    checked = time.perf_counter()
    seconds = (after_releases - began) * len(graph) / len(stances)
    seconds += (checked - after_releases) * steps / len(support)
    edges = graph.steps.edges[graph.steps.edges["known"] == 1]
    size += _packed(edges) * 2 * steps + _packed(graph.steps.releases[stances]) * len(graph)
    return Estimate(candidates, seconds, size, parts_of_two_limb_table(graph).count())


def _sample(graph: TwoLimbGraph) -> tuple[IntArray, IntArray, IntArray]:
    """Return the support limb, the stance before and the stance after of some steps."""
    rows = list(zip(*np.nonzero(graph.degree > 1), strict=True))
    found, count = [], 0
    for k in np.random.default_rng(0).permutation(len(rows)):
        support, point = rows[k]
        begin, end = graph.row_start[support, point : point + 2]
        row = graph.rows[support, begin : min(end, begin + SIDE)]
        i, j = np.tril_indices(len(row), -1)
        found.append(np.stack([np.full(len(i), support), row[i], row[j]]))
        count += len(i)
        if count >= SAMPLE:
            break
    support, before, after = np.concatenate(found, axis=1)
    return support, before, after


def _packed(rows: NDArray[Any]) -> float:
    """Return the number of bytes that each of some records takes in a file."""
    return len(zlib.compress(rows.tobytes())) / len(rows)
