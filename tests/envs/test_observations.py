"""What agents see, and the space it lies in."""

import numpy as np
from paper import NO_COLLISIONS
from scipy.spatial.transform import Rotation

from mlivr_gym import GraspMap, stance_graph
from mlivr_gym.envs.observations import ObservationArrays, ObservationTable, observation_space


def test_whole_cabin_and_every_point_lie_in_the_space():
    """A rail at the bottom of a high cabin, and one far outside."""
    rail = {"face": "deck", "normal": [0, 0, 1], "width": 0.02}
    low, high = [0.0, -1.0, 0.0], [2.0, 1.0, 9.0]
    ends = {"near": ([0, 0, 0], [1, 0, 0]), "far": ([9, 0, -9], [9.4, 0, -9])}
    segments = [{"id": k, "start": a, "end": b, **rail} for k, (a, b) in ends.items()]
    grasp_map = GraspMap.from_dict({"segments": segments, "cabin": {"min": low, "max": high}})
    space = observation_space(stance_graph(grasp_map, settings=NO_COLLISIONS))
    for place in (*np.array([low, high]), *grasp_map.positions):
        assert space["goal"].contains(place.astype(np.float32))
        assert space["base_position"].contains(place.astype(np.float32))
        assert space["grasps"].contains(np.tile(place, 2).astype(np.float32))


def test_what_many_agents_see_is_what_the_graph_says_of_each(small_graph):
    """Orientations by SciPy, branches by Python's digits."""
    graph, rng, count = small_graph, np.random.default_rng(0), 40
    rows, goals = rng.integers(0, len(graph), count), rng.normal(size=(count, 3))
    masks = rng.integers(0, 1 << 16, (count, 2))
    seen = ObservationArrays.of(ObservationTable.of(graph), rows, masks, goals)
    turns = graph.base_rotation[rows]
    expected = {
        "stance": graph.points[rows],
        "grasps": [graph.grasp_map.positions[points].ravel() for points in graph.points[rows]],
        "base_position": graph.base_position[rows],
        "base_quaternion": seen.base_quaternion,
        "goal": goals,
        "branches": [
            [int(digit) for mask in row for digit in f"{mask:016b}"[::-1]] for row in masks.tolist()
        ],
    }
    assert seen.observation().keys() == expected.keys()
    for name, values in seen.observation().items():
        np.testing.assert_allclose(values, expected[name], atol=1e-6)
    # Of two quaternions of a half turn either will do.
    assert (seen.base_quaternion[:, 0] >= 0.0).all()
    found = Rotation.from_quat(seen.base_quaternion, scalar_first=True)
    np.testing.assert_allclose(found.as_matrix(), turns, atol=1e-6)
    np.testing.assert_array_equal(seen.precise_base_position, graph.base_position[rows])
    np.testing.assert_array_equal(seen.w_m, graph.w_m[rows])
    np.testing.assert_array_equal(seen.w_b, graph.w_b[rows])
    np.testing.assert_allclose(
        seen.goal_distance, np.linalg.norm(seen.precise_base_position - goals, axis=1)
    )
