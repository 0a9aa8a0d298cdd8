"""Stages of the search over a table: search parameters, used in order until a path is optimal.

With two limbs one stage suffices. With more limbs the search is an anytime search: weighted A* with
decreasing weights finds a first path soon and better ones later, as in ARA* (Likhachev, Gordon and
Thrun 2003), but every stage starts anew (Richter, Thayer and Ruml 2010), with the incumbent of the
stage before. What a check of an edge finds then holds for the label at hand alone, so that stages
which use earlier checks find paths, and stages which ignore them prove lower bounds. The last stage
proves the optimum, whatever the checks find.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

from mlivr_gym.planners.label_search import SearchParameters


class SearchStage(NamedTuple):
    """One stage: the parameters of its searches, and which checks of edges they use."""

    parameters: SearchParameters
    """Parameters of each search of the stage."""
    ignores_checked_edges: bool = False
    """Whether edges that were checked with other labels count as unchecked, so that every plan is
    among the paths of the stage. Its result then bounds the cost of all plans from below, if the
    weight of the cost is 1 or the queue was exhausted. Of no effect with two limbs, whose checks
    hold for all labels."""
    only_after_exhaustion: bool = False
    """Whether the stage is skipped unless the stage before exhausted its queue without a path."""
    max_searches: int | None = None
    """Number of searches after which the stage ends, by default none."""
    ordered_by_checks: bool = False
    """Whether the results of checks order the queue, see `check_history`. Such a stage finds paths
    among obstacles, and proves nothing."""
    max_relaxations: int = 0
    """How often in a row the limit of labels may be reached, each time with a relaxed order or a
    larger limit, see `CheckHistory.relax`, before the stage ends."""


FIRST_PATH_PARAMETERS = 1.0 / 1.3, 8
"""Weight of the cost so far, and maximum number of labels of a node, for a first path."""

FIRST_PATH, QUICK_FIRST_PATH = (
    SearchStage(SearchParameters(*FIRST_PATH_PARAMETERS)),
    SearchStage(SearchParameters(*FIRST_PATH_PARAMETERS, 100_000)),
)
"""The stage that finds a first path, and the same with fewer labels where another stage can
follow."""

BY_WEIGHT = SearchStage(
    SearchParameters(labels_per_node=8, max_expansions=200, check_when_popped=True)
)
"""The stage in the order of the queue that the user chose, which the others follow if it finds no
path; the weight of the cost is that of the query."""

EXACT_STAGES = (
    SearchStage(SearchParameters(), ignores_checked_edges=True),
    SearchStage(SearchParameters()),
    SearchStage(
        SearchParameters(check_when_popped=True, equal_only=True), ignores_checked_edges=True
    ),
)
"""The cheapest path over the edges of the table (a lower bound of all plans), that over the edges
checked so far, and the cheapest plan, for which every edge is checked with the label at hand and no
label is dropped unless an equal one costs no more."""

STAGES = FIRST_PATH, SearchStage(SearchParameters(1.0 / 1.1, 8)), *EXACT_STAGES
"""The stages without obstacles, in order: two that find paths, and those that prove the optimum."""

ENCLOSURE_PROBE = SearchStage(
    SearchParameters(0.5, max_expansions=300, check_when_popped=True), ignores_checked_edges=True
)
"""A short search that exhausts its queue if obstacles enclose the start. That proves nothing yet,
since dominance may have dropped a label that leads out."""

ENCLOSURE_PROOF = SearchStage(
    SearchParameters(0.5, max_expansions=300, check_when_popped=True, equal_only=True),
    ignores_checked_edges=True,
    only_after_exhaustion=True,
)
"""The same search without dominance between different labels. It expands every state that can be
reached, so if it exhausts its queue, too, it proves that no plan exists."""

FIRST_PATH_AMONG_OBSTACLES = SearchStage(
    SearchParameters(1.0 / 3.0, labels_per_node=2, max_labels=25_000),
    ordered_by_checks=True,
    max_relaxations=sys.maxsize,
)
"""The stage that finds a first path among obstacles."""

QUICK_FIRST_PATH_AMONG_OBSTACLES = FIRST_PATH_AMONG_OBSTACLES._replace(
    max_searches=50, max_relaxations=3
)
"""The same with little effort, before further nodes are checked against the obstacles."""

OBSTACLE_STAGES = ENCLOSURE_PROBE, ENCLOSURE_PROOF, FIRST_PATH_AMONG_OBSTACLES, *STAGES
"""The stages among obstacles, in order."""
