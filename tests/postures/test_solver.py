from dataclasses import replace

import numpy as np
from random_steps import neighbouring_points

from mlivr_gym import Settings, robot_spec, stance_graph
from mlivr_gym.postures.postures import FIELDS
from mlivr_gym.postures.solver import PostureSolver


def test_stances_have_the_same_postures_alone_as_with_others(jem):
    """Those of the same relative geometry share one, also where a box changes it."""
    graph = stance_graph(jem, "mlivr3")
    stances = neighbouring_points(graph, 100, 0)
    stances = np.concatenate([stances, np.roll(stances, 1, axis=1)])
    # Points along a rail have the same surroundings, or others.
    stances = np.concatenate([stances, np.minimum(stances + 1, len(jem) - 1)])
    together = graph.solver.solve(stances)
    for k in range(0, len(stances), 3):
        alone = PostureSolver(jem, graph.robot, graph.settings).solve(stances[[k]])
        for name in FIELDS:
            np.testing.assert_array_equal(getattr(together, name)[k], getattr(alone, name)[0])
    assert (together.branch_sets > 0).all(axis=1).sum() > 30


def test_counts_agree_with_the_independent_calculation(jem):
    """43,540 ordered pairs within 2.4 m, 27,010 in reach by heights alone, no opposite walls."""
    graph = stance_graph(
        jem,
        replace(robot_spec("mlivr2"), rolls=(0.0,)),
        Settings(collisions=False, manipulability=False, transitions=False),
    )
    assert graph.listed.counts["considered"] == 43540
    normals = jem.normals[graph.points]
    opposed = (normals[:, 0] * normals[:, 1]).sum(axis=1) < -0.5
    assert (~opposed).sum() == 27010
    kept = (graph.w_m.min(axis=1) >= 0.1) & (graph.w_b >= 0.001) & ~opposed
    assert abs(kept.sum() - 20842) < 0.01 * 20842
