"""The table of a stance graph: its nodes and edges, and the postures where all stances are listed.

For two limbs on a module all stances are listed when the graph is made, and a table that was built
has of every edge exactly what the support keeps. For three and four limbs a table that was built
has an upper bound of what the supports keep; nodes are listed without their postures.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.node_table import NodeTable

COUNTS = ("considered", "reachable", "no_departure", "self", "cabin", "handrail")
"""Names of the counts of ordered pairs of points: those considered, those in reach of the limbs,
and of those above the thresholds the ones from which a limb cannot depart with `w_m` above
`Settings.path_floor` and every joint in its window, and those that collide, by cause."""


class ListedStances(NamedTuple):
    """What is known of the n stances of a graph that are all listed."""

    postures: Postures
    """Their postures, in lexical order of the points."""
    counts: Mapping[str, int]
    """Numbers of `COUNTS`."""
    releases: Any = None
    """What can be released, rows of `ReleaseRecord`, shape (n, N); None while it is not known."""


class GraphTable(NamedTuple):
    """The table of a stance graph, without obstacles and occupied points."""

    nodes: NodeTable
    """Nodes and edges."""
    is_exact: bool
    """Whether edges and releases are exact, and not upper bounds."""
    listed: ListedStances | None = None
    """What else is known if all stances are listed."""

    @property
    def is_built(self) -> bool:
        """Whether releases and edges were checked."""
        return self.listed is None or self.is_exact
