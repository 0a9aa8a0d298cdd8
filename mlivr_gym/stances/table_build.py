"""Build the table of any stance graph, and store it where graphs find it."""

from __future__ import annotations

from pathlib import Path

from mlivr_gym.errors import SettingError
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.node_table_build import build, parts_of_nodes
from mlivr_gym.stances.node_table_file import NODE_TABLES, node_table, set_table
from mlivr_gym.stances.two_limb_build import build_two_limb_table, built_two_limb_table
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_table_file import TWO_LIMB_TABLES
from mlivr_gym.stances.workers import Progress


def build_table(
    graph: TwoLimbGraph | ImplicitGraph, progress: Progress | None = None
) -> Path | None:
    """Build the table of a stance graph once, and store it where graphs find it.

    For two limbs the table is complete, with all steps; for three and four limbs it has all nodes
    and the branches that each step keeps at most. A build that was stopped continues where it was.
    If the table cannot be stored, a warning says so, and the graph has its table all the same.

    Parameters
    ----------
    graph
        The stance graph, without obstacles and occupied points.
    progress
        Called with the finished share of the work, from 0 to 1.

    Returns
    -------
    Path | None
        The file of the table in the cache folder or the package; None if it is not stored.

    Raises
    ------
    SettingError
        If there are obstacles or occupied points.
    TableError
        If robots with this number of limbs have no table, or the map has too many points.

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> graph = stance_graph()
    >>> path = build_table(graph)
    >>> graph.is_complete
    True
    """
    if graph.obstacles or graph.occupied:
        raise SettingError("tables are built without obstacles and occupied points; clear them")
    if isinstance(graph, TwoLimbGraph):
        return build_two_limb_table(graph, progress)
    path, table = NODE_TABLES.cached(graph), node_table(graph)
    if table is None:
        parts = parts_of_nodes(graph)
        table = build(graph, progress, parts)
        set_table(table, graph)
        path = NODE_TABLES.cache(graph, table)
        if path is not None:
            parts.remove()
    return path


def is_built(graph: TwoLimbGraph | ImplicitGraph) -> bool:
    """Return whether the table of a graph ships or was built."""
    built = built_two_limb_table(graph) if isinstance(graph, TwoLimbGraph) else node_table(graph)
    return built is not None


def write_built(graph: TwoLimbGraph | ImplicitGraph, path: Path) -> None:
    """Write the table of a graph, which has been built, to a file that can be passed on.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    if isinstance(graph, TwoLimbGraph):
        TWO_LIMB_TABLES.write(graph, graph.file_contents(), path)
    else:
        assert graph.table is not None
        NODE_TABLES.write(graph, graph.table, path)


def name_of(graph: TwoLimbGraph | ImplicitGraph) -> str:
    """Return the name under which a cache folder must have the file of `write_built`."""
    return (TWO_LIMB_TABLES if isinstance(graph, TwoLimbGraph) else NODE_TABLES).name(graph)
