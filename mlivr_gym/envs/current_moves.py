"""The moves of a world that may change: points are occupied, obstacles added and removed."""

from __future__ import annotations

from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.moves import GraphMoves, Moves, TableMoves
from mlivr_gym.stances.node_table_file import node_table
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import step_tables


class CurrentMoves:
    """Moves of a stance graph, kept for as long as its world does not change.

    Attributes
    ----------
    graph
        The stance graph.
    tabled
        Whether they are read from exact tables.
    """

    def __init__(self, graph: StanceGraph) -> None:
        """Take exact tables where every step is known; of more limbs, the table of all nodes."""
        self.graph, self.tabled = graph, False
        self._moves: Moves | None = None
        self._version = graph.version
        if isinstance(graph, LazyGraph):
            node_table(graph)

    def now(self) -> Moves:
        """What answers for the world as it is now."""
        if self._moves is None or self._version != self.graph.version:
            graph = self.graph
            known = isinstance(graph, PairGraph) and graph.complete
            self._moves = self._read() if self.tabled or known else GraphMoves(graph)
            self._version = self.graph.version
        return self._moves

    def from_tables(self) -> TableMoves:
        """The same from exact tables, which are used from now on.

        Raises
        ------
        SettingError
            If the robot has more than two limbs.
        """
        if not self.tabled:
            self._moves, self._version = self._read(), self.graph.version
            self.tabled = True
        moves = self.now()
        assert isinstance(moves, TableMoves)
        return moves

    def _read(self) -> TableMoves:
        tables = step_tables(self.graph)
        assert isinstance(self.graph, PairGraph)
        return TableMoves(self.graph, tables)
