"""Build the complete table of two limbs."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.stances.parts import Parts, Progress
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_table_file import TwoLimbStances


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
    chunk = max(1, m // 16)
    blocks = [(at, min(at + chunk, 2 * m)) for at in range(0, 2 * m, chunk)]
    found = parts.of_blocks(rows, blocks, (graph,), 1, progress)
    known.edges[...] = np.concatenate([edges for (edges,) in found])
    graph.is_complete = True
    return graph.file_contents()


def _releases(graph: TwoLimbGraph) -> list[NDArray[Any]]:
    """Compute the branches on which every limb can be released."""
    graph.check_releases(np.indices((len(graph), 2)).reshape(2, -1).T)
    return [graph.steps.releases]


def rows(begin: int, end: int, graph: TwoLimbGraph) -> list[NDArray[Any]]:
    """Check the steps of some rows, those of limb 0 before those of limb 1, and return them."""
    steps, m = graph.steps, len(graph.grasp_map)
    found = [graph.edges_of_row(*divmod(row, m)) for row in range(begin, end)]
    support = np.repeat(np.arange(begin, end) // m, [one.shape[1] for one in found])
    graph.check_steps(support, *np.concatenate(found, axis=1))
    first = np.append(steps.offset.ravel(), len(steps.edges))
    return [steps.edges[first[begin] : first[end]]]
