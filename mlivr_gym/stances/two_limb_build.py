"""Build the complete table of two limbs."""

from __future__ import annotations

from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.stances.parts import Parts
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_table_file import TWO_LIMB_TABLES
from mlivr_gym.stances.workers import Progress


def fill_rows(
    graph: TwoLimbGraph, progress: Progress | None = None, parts: Parts | None = None
) -> None:
    """Check every step of a graph once.

    Finished parts are stored until all are, only without obstacles and occupied points.
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
