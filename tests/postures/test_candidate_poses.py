"""Numbers of candidate base poses, compared with the postures that have them."""

from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.postures.candidate_poses import bases_at
from mlivr_gym.stances.random_states import random_state


@pytest.mark.parametrize(
    ("robot", "moved"), [("mlivr2", 0.0), ("mlivr2", 4e-8), ("mlivr3", 4e-8), ("mlivr4", 4e-8)]
)
def test_a_number_determines_the_base_pose_of_a_node_to_the_last_bit(small_map, robot, moved):
    """Also with points moved by less than the rounded coordinates resolve."""
    rng = np.random.default_rng(4)
    places = small_map.positions + rng.uniform(-moved, moved, small_map.positions.shape)
    graph = stance_graph(replace(small_map, positions=places), robot)
    stances = np.array([random_state(graph, rng).stance for _ in range(15)])
    postures = graph.nodes(stances)
    assert len(set(postures.pose_number.tolist())) > 3
    position, rotation = bases_at(graph.grasp_map, graph.robot, stances, postures.pose_number)
    np.testing.assert_array_equal(position, postures.base_position)
    np.testing.assert_array_equal(rotation, postures.base_rotation)
    for stance, number, base in zip(
        stances.tolist(), postures.pose_number.tolist(), postures.base_position, strict=True
    ):
        pose_number, _ = graph.solver.candidate_poses(stance)
        apart = np.linalg.norm(pose_number - base, axis=1)
        assert apart[number] < 1e-6
