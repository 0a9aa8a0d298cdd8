"""Checks of edges in a search, up to the effort that its query allows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import IntArray
from mlivr_gym.planners.label_search import EXPANSION_LIMIT, SearchOutcome
from mlivr_gym.planners.lazy_table import LazyTable
from mlivr_gym.planners.path_search import PathSearch


class CheckBudget:
    """The checks of one search over a table; call it as the search's function that checks edges.

    Attributes
    ----------
    is_spent
        Whether edges were left unchecked, because the effort of the query was spent.
    """

    def __init__(self, path_search: PathSearch, lazy_table: LazyTable) -> None:
        """Check edges of a table for a search."""
        self._path_search, self._lazy_table = path_search, lazy_table
        self.is_spent = False

    def __call__(self, edges: IntArray, branch_sets: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Check edges, see `LazyTable.branch_sets_after`; drop them if the effort is spent."""
        path_search = self._path_search
        if path_search.effort >= path_search.search.effort:
            self.is_spent = True
            return np.zeros_like(branch_sets)
        pieces = path_search.clock.pieces("edges", len(edges))
        after = [self._lazy_table.branch_sets_after(edges[k], branch_sets[k]) for k in pieces]
        return np.concatenate([branch_sets[:0], *after])

    def outcome(self, found: SearchOutcome) -> SearchOutcome:
        """Return what a search found, which proves nothing if edges were left unchecked."""
        if not self.is_spent:
            return found
        return found._replace(lower_bound=0.0, end=EXPANSION_LIMIT)
