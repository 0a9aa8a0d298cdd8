"""The table of nodes of two limbs against what the graph knows of every step, in Python."""

import numpy as np
import pytest
from compiled import called

from mlivr_gym import Settings, stance_graph
from mlivr_gym.compiled.limb_branch_sets import unpacked
from mlivr_gym.stances.node_edges import branches_lost, edge_ends
from mlivr_gym.stances.two_limb_nodes import two_limb_nodes


@pytest.mark.parametrize("transitions", [True, False])
def test_the_table_tells_what_is_known_of_every_step(small_map, transitions):
    """A step that is not known keeps all branches that both of its stances have."""
    fewer = small_map.subset(small_map.positions[:, 0] < 2.2, "smaller")
    graph = stance_graph(fewer, settings=Settings(transitions=transitions, collisions=transitions))
    rng, points = np.random.default_rng(0), graph.points
    steps = [
        (held, a, b)
        for held in range(2)
        for a, b in np.argwhere(points[:, held, None] == points[:, held]).tolist()
        if a != b
    ]
    if transitions:
        some = np.array(steps)[rng.random(len(steps)) < 0.5]
        graph.check_steps(*some.T.copy())
        graph.check_releases(np.argwhere(rng.random(points.shape) < 0.5))
    table = two_limb_nodes(graph.steps, graph.pose_number)
    np.testing.assert_array_equal(table.points, points)
    np.testing.assert_array_equal(unpacked(table.branch_sets, 2), graph.branch_sets)
    told = {}
    bits = np.arange(int(table.offset[-1]))
    (before, moving), (after, moved), _ = edge_ends(table, bits)
    np.testing.assert_array_equal(moving, moved)
    for bit, a, b, limb in zip(bits, before, after, moving, strict=True):
        if a != b and int(table.joined[bit // 64]) >> int(bit % 64) & 1:
            told[1 - int(limb), int(a), int(b)] = int(called(branches_lost)(table, int(bit)))
    known = graph.steps.releases["known"] if transitions else np.zeros(points.shape, dtype=bool)
    releasable = (
        np.where(known, graph.releasable, graph.branch_sets) if transitions else graph.branch_sets
    )
    expected, loses_branches = {}, 0
    for held, a, b in steps:
        shared = int(graph.branch_sets[a, held] & graph.branch_sets[b, held])
        edge = graph.steps.edges[graph._known.index(held, a, b)] if transitions else None
        kept = shared & int(edge["kept"]) if transitions and edge["known"] else shared
        if kept and releasable[[a, b], 1 - held].all():
            expected[held, a, b] = shared & ~kept
            loses_branches += kept != shared
    assert told == expected
    assert (loses_branches > 0) == transitions
    np.testing.assert_array_equal(unpacked(table.releasable, 2), releasable)
