"""Stages of the search over a table: search parameters, used in order until a path is optimal.

With two limbs one stage suffices. With more limbs weighted A* with decreasing weights finds a first
path soon and better ones later, as in ARA* (Likhachev, Gordon and Thrun 2003), but every stage
starts anew (Richter, Thayer and Ruml 2010), with the incumbent of the stage before.
"""

from __future__ import annotations

from typing import NamedTuple

from mlivr_gym.planners.label_search import SearchParameters


class SearchStage(NamedTuple):
    """One stage: the parameters of its searches, and what they prove."""

    parameters: SearchParameters
    """Parameters of each search of the stage."""
    proves_lower_bound: bool = False
    """Whether the result is a valid lower bound of the cost of all plans. With three and more limbs
    the results of checked edges are then ignored."""
    only_after_exhaustion: bool = False
    """Whether the stage is skipped unless the stage before exhausted its queue without a path."""


FIRST_PATH_PARAMETERS = 1.0 / 1.3, 8
"""Weight of the cost so far, and maximum number of labels of a node, for a first path."""

FIRST_PATH, QUICK_FIRST_PATH = (
    SearchStage(SearchParameters(*FIRST_PATH_PARAMETERS)),
    SearchStage(SearchParameters(*FIRST_PATH_PARAMETERS, 100_000)),
)
"""The stage that finds a first path, and the same with fewer labels where another stage can
follow."""

STAGES = (
    FIRST_PATH,
    SearchStage(SearchParameters(1.0 / 1.1, 8)),
    SearchStage(SearchParameters(), proves_lower_bound=True),
    SearchStage(SearchParameters()),
)
"""The stages without obstacles, in order."""

ENCLOSURE_PROBE = SearchStage(
    SearchParameters(0.5, max_expansions=300, lazy=True), proves_lower_bound=True
)
"""A short search that ends early if few states can be reached, as in an enclosed space."""

ENCLOSURE_PROOF = SearchStage(
    SearchParameters(0.5, max_expansions=300, lazy=True, equal_only=True),
    proves_lower_bound=True,
    only_after_exhaustion=True,
)
"""The same search without dominance between different labels: it expands every state that can be
reached, which proves that no plan exists."""

OBSTACLE_STAGES = ENCLOSURE_PROBE, ENCLOSURE_PROOF, SearchStage(SearchParameters(0.5, 8)), *STAGES
"""The stages among obstacles, in order."""
