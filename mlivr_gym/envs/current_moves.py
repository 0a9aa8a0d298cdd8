"""Steps of a stance graph whose world may change, by occupied points and obstacles."""

from __future__ import annotations

from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.moves import GraphMoves, Moves, TableMoves
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import step_tables
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph


class CurrentMoves:
    """The steps of a stance graph, evaluated again when its world changes.

    `uses_tables` is whether they must come from exact tables.
    """

    def __init__(self, graph: StanceGraph) -> None:
        """Start without steps; load the node table of a graph of three or more limbs."""
        self.graph, self.uses_tables = graph, False
        self._moves: Moves | None = None
        self._version = graph.version
        if isinstance(graph, ImplicitGraph):
            find_table(graph)

    def current(self) -> Moves:
        """Return the moves of the present world, from exact tables if all steps are known."""
        if self._moves is None or self._version != self.graph.version:
            graph = self.graph
            known = isinstance(graph, TwoLimbGraph) and graph.is_complete
            self._moves = self._table_moves() if self.uses_tables or known else GraphMoves(graph)
            self._version = self.graph.version
        return self._moves

    def use_tables(self) -> TableMoves:
        """Return the moves from exact tables, which are used from now on.

        Raises a `SettingError` if the robot has more than two limbs.
        """
        if not self.uses_tables:
            self._moves, self._version = self._table_moves(), self.graph.version
            self.uses_tables = True
        moves = self.current()
        assert isinstance(moves, TableMoves)
        return moves

    def _table_moves(self) -> TableMoves:
        """Return the moves from the exact tables of the present world."""
        tables = step_tables(self.graph)
        assert isinstance(self.graph, TwoLimbGraph)
        return TableMoves(self.graph, tables)
