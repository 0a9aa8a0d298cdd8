"""Stages of the search over a table of three or four limbs, used in order until a path is optimal.

It is an anytime search: weighted A* with decreasing weights finds a first path soon and better ones
later, as in ARA* (Likhachev, Gordon and Thrun 2003), but every stage starts anew (Richter, Thayer
and Ruml 2010), with the incumbent of the stage before. The last one has weight 1 and every label,
so that its path, once all of its edges were checked, is optimal.
"""

from __future__ import annotations

from mlivr_gym.planners.label_search import SearchParameters


def weighted(weight: float) -> SearchParameters:
    """Return a stage of weighted A*, with few labels of a node."""
    return SearchParameters(1.0 / weight, labels_per_node=8)


BY_WEIGHT = SearchParameters(labels_per_node=8, max_expansions=200, check_when_popped=True)
"""The stage in the order of the queue that the user chose, which the others follow if it finds no
path; the weight of the cost is that of the query."""

STAGES = weighted(1.3), weighted(1.1), SearchParameters()
"""The stages without obstacles, in order: two that find paths, and one that proves the optimum."""

FEW_LABELS = 100_000
"""Maximum number of labels of a search after which another one with better bounds, or of smaller
weight, can follow."""


def first_of(stages: tuple[SearchParameters, ...]) -> tuple[SearchParameters]:
    """Return the first stage with few labels."""
    return (stages[0]._replace(max_labels=FEW_LABELS),)


OBSTACLE_STAGES = *first_of((weighted(3.0),)), *STAGES
"""The stages among obstacles, where many a path turns out to be blocked: a larger weight comes
first, with which each takes less time to find."""
