"""What agents see, and the space it lies in."""

import numpy as np
from paper import NO_COLLISIONS

from mlivr_gym import GraspMap, stance_graph
from mlivr_gym.envs.observations import observation_space


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
