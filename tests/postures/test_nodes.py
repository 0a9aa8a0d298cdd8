"""Nodes agree with their postures; other stances are rejected early, and solved on request."""

import numpy as np
import pytest

from mlivr_gym import Settings, stance_graph
from mlivr_gym.postures.postures import FIELDS


@pytest.mark.parametrize(
    ("robot", "rules"),
    [("mlivr2", {}), ("mlivr3", {"manipulability": False}), ("mlivr4", {"collisions": False})],
)
def test_nodes_are_those_of_the_postures(small_map, robot, rules):
    graph, again = (stance_graph(small_map, robot, Settings(**rules)) for _ in range(2))
    rng = np.random.default_rng(0)
    rows = np.array([rng.permutation(len(small_map))[: graph.limbs] for _ in range(300)])
    rows = rows[[graph.compatible[np.ix_(row, row)].sum() == graph.limbs**2 - graph.limbs
                 for row in rows]]  # fmt: skip
    nodes, postures = graph.nodes(rows), again.postures(rows)
    node = again.is_node(postures)
    np.testing.assert_array_equal(graph.is_node(nodes), node)
    # Solved on request afterwards, rejected stances have the results of a fresh graph.
    for found, kept in ((nodes, node), (graph.postures(rows), slice(None))):
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(found, name)[kept], getattr(postures, name)[kept])
    assert 0 < node.sum() < len(rows)
