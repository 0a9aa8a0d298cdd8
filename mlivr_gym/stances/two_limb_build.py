"""Build the complete table of two limbs."""

from __future__ import annotations

from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.stances.parts import Parts
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_table_file import TwoLimbStances
from mlivr_gym.stances.workers import Progress


def fill_rows(
    graph: TwoLimbGraph, progress: Progress | None = None, parts: Parts | None = None
) -> TwoLimbStances:
    """Check every step of a graph once, and return all that is known without obstacles.

    Finished parts are stored until all are, only without obstacles and occupied points.
    """
    if graph.is_complete:
        return graph.file_contents()
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
    return graph.file_contents()


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
