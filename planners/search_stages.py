"""Stages of the search over a table of three or four limbs, used in order until a path is optimal.

It is an anytime search: weighted A* with decreasing weights finds a first path soon and better ones
later, as in ARA* (Likhachev, Gordon and Thrun 2003), but every stage starts anew (Richter, Thayer
and Ruml 2010), with the incumbent of the stage before. What a check of an edge finds then holds for
the label at hand alone, so that stages which use earlier checks find paths, and stages which ignore
them prove lower bounds. The last stage proves the optimum, whatever the checks find.
"""

from __future__ import annotations

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


def weighted(weight: float) -> SearchStage:
    """Return a stage of weighted A*, with few labels of a node."""
    return SearchStage(SearchParameters(1.0 / weight, labels_per_node=8))


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

STAGES = weighted(1.3), weighted(1.1), *EXACT_STAGES
"""The stages without obstacles, in order: two that find paths, and those that prove the optimum."""

FEW_LABELS = 100_000
"""Maximum number of labels of a search after which another one with better bounds, or of smaller
weight, can follow."""


def first_of(stages: tuple[SearchStage, ...]) -> tuple[SearchStage]:
    """Return the first stage with few labels."""
    few = stages[0].parameters._replace(max_labels=FEW_LABELS)
    return (stages[0]._replace(parameters=few),)


OBSTACLE_STAGES = *first_of((weighted(3.0),)), *STAGES
"""The stages among obstacles, where many a path turns out to be blocked: a larger weight comes
first, with which each takes less time to find."""
