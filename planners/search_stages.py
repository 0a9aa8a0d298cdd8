"""Stages of a search over a table, used in order until a path is proved good enough.

It is an anytime search: weighted A* finds a first path soon and better ones
later, as in ARA* (Likhachev, Gordon and Thrun 2003), but every stage starts anew (Richter, Thayer
and Ruml 2010), with the incumbent of the stage before. The last one has every label, so that its
path, once all of its edges were checked, is optimal.
"""

from __future__ import annotations

from mlivr_gym.planners.label_search import SearchParameters

FREE, AMONG_OBSTACLES = (1.3,), (3.0,)
"""Weights of the stages before the last one; among obstacles many a path turns out to be blocked,
and with a larger weight each takes less time to find."""

LABELS_PER_NODE = 8
"""Maximum number of labels of a node in a weighted stage."""

BY_WEIGHT = SearchParameters(
    labels_per_node=LABELS_PER_NODE, max_expansions=200, check_when_popped=True
)
"""The stage in the order of the queue that the user chose, which the others follow if it finds no
path; the weight of the cost is that of the query."""

FEW_LABELS = 100_000
"""Maximum number of labels of a search after which another one with better bounds can follow."""


def stages(weights: tuple[float, ...], last: SearchParameters) -> tuple[SearchParameters, ...]:
    """Return stages of some weights, and the last one."""
    few = last._replace(labels_per_node=LABELS_PER_NODE)
    return (*(few._replace(cost_weight=last.cost_weight / w) for w in weights), last)
