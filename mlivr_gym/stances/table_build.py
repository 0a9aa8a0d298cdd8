"""Find or build the table of any stance graph, and store it where graphs find it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from inspect import getfile
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.errors import SettingError
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.node_table_build import build
from mlivr_gym.stances.node_table_file import NODE_TABLES
from mlivr_gym.stances.parts import PartArrays, Parts, Progress
from mlivr_gym.stances.table_files import TableFiles
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_table_file import TWO_LIMB_TABLES, TwoLimbStances

TableGraph = TwoLimbGraph | ImplicitGraph
"""A stance graph that may have a table."""


def files_of(graph: TableGraph) -> TableFiles[Any]:
    """Return the files of tables of graphs with as many limbs."""
    return TWO_LIMB_TABLES if isinstance(graph, TwoLimbGraph) else NODE_TABLES


@checked()
def find_table(graph: TableGraph) -> tuple[Path | None, Any] | None:
    """Return the table that ships or was built for a graph and its file; None if there is none.

    The graph uses it from then on, also if it was made before the table was stored. A file that
    cannot be used is skipped with a warning, of two limbs when the graph is made.
    """
    found = files_of(graph).find(graph, warn=isinstance(graph, ImplicitGraph))
    if found is not None:
        _use(graph, found[1])
    return found


def _use(graph: TableGraph, table: Any) -> None:
    """Give a graph its table."""
    if isinstance(graph, ImplicitGraph):
        graph.table = table
        return
    with graph.lock:
        if not (graph.is_complete or graph.obstacles or graph.occupied):
            graph.steps.edges[...], graph.steps.releases[...] = table.edges, table.releases
            graph.is_complete = True


@checked()
def build_table(graph: TableGraph, progress: Progress | None = None) -> Path | None:
    """Build the table of a stance graph once, and store it where graphs find it.

    For two limbs the table is complete, with all steps; for three and four limbs it has all nodes
    and the branches that each step keeps at most. A build that was stopped continues where it was.
    If the table cannot be stored, a warning says so, and the graph has its table all the same.

    The graph has no obstacles and no occupied points. `progress` is called with the finished share
    of the work, from 0 to 1. Returned is the file of the table in the cache folder or the package;
    None if it is not stored. Raises a `SettingError` if there are obstacles or occupied points, and
    a `TableError` if robots with this number of limbs have no table, or the map has too many
    points.


    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> graph = stance_graph()
    >>> path = build_table(graph)
    >>> graph.is_complete
    True
    """
    with graph.lock:
        if graph.obstacles or graph.occupied:
            raise SettingError("tables are built without obstacles and occupied points; clear them")
        found = find_table(graph)
        if found is None:
            work: Callable[..., Any] = fill_rows if isinstance(graph, TwoLimbGraph) else build
            parts = Parts.of(graph, getfile(work))
            table = work(graph, progress, parts)
            _use(graph, table)
            files = files_of(graph)
            found = files.remember(graph, files.cache(graph, table), table)
            if found[0] is not None:
                parts.remove()
        return found[0]


def write_built(graph: TableGraph, path: Path) -> None:
    """Write the table of a graph, which has been built, to a file that can be passed on.

    Raises a `FileError` if the file cannot be written.
    """
    table = graph.file_contents() if isinstance(graph, TwoLimbGraph) else graph.table
    files_of(graph).write(graph, table, path)


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


def _releases(graph: TwoLimbGraph) -> PartArrays:
    """Compute the branches on which every limb can be released."""
    graph.check_releases(np.indices((len(graph), 2)).reshape(2, -1).T)
    return [graph.steps.releases]


def rows(begin: int, end: int, graph: TwoLimbGraph) -> PartArrays:
    """Check the steps of some rows, those of limb 0 before those of limb 1, and return them."""
    steps, m = graph.steps, len(graph.grasp_map)
    found = [graph.edges_of_row(*divmod(row, m)) for row in range(begin, end)]
    support = np.repeat(np.arange(begin, end) // m, [one.shape[1] for one in found])
    graph.check_steps(support, *np.concatenate(found, axis=1))
    first = np.append(steps.offset.ravel(), len(steps.edges))
    return [steps.edges[first[begin] : first[end]]]
