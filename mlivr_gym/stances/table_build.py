"""Find or build the table of a stance graph, and store it where graphs find it."""

from __future__ import annotations

from inspect import getfile
from pathlib import Path

from mlivr_gym.arguments import checked
from mlivr_gym.errors import SettingError
from mlivr_gym.stances.graph_table import GraphTable
from mlivr_gym.stances.node_table_build import build
from mlivr_gym.stances.parts import Parts, Progress
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.table_file import TABLES


@checked()
def find_table(graph: StanceGraph) -> tuple[Path | None, GraphTable] | None:
    """Return the table that ships or was built for a graph and its file; None if there is none.

    The graph uses it from then on, also if it was made before the table was stored. A file that
    cannot be used is skipped with a warning, of two limbs when the graph is made.
    """
    with graph.lock:
        found = stored_table(graph)
        if found is not None:
            graph.graph_table = found[1]
        return found


def stored_table(graph: StanceGraph) -> tuple[Path | None, GraphTable] | None:
    """Return what `find_table` does, without the lock of the graph, which does not use it yet."""
    return TABLES.find(graph, warn=not graph.lists_all)


@checked()
def build_table(graph: StanceGraph, progress: Progress | None = None) -> Path | None:
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
            parts = Parts.of(graph, getfile(build))
            graph.graph_table = build(graph, progress, parts)
            stored = TABLES.cache(graph, graph.graph_table)
            found = TABLES.remember(graph, stored, graph.graph_table)
            if stored is not None:
                parts.remove()
        return found[0]


def write_built(graph: StanceGraph, path: Path) -> None:
    """Write the table of a graph, which has been built, to a file that can be passed on.

    Raises a `FileError` if the file cannot be written.
    """
    assert graph.graph_table is not None
    TABLES.write(graph, graph.graph_table, path)
