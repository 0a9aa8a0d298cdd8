"""What an agent sees. The single and the vector environment share it."""

from __future__ import annotations

from typing import TypedDict

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.stances.moves import Place
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

REMEMBERED = 4096
"""Stances whose observation an `Observer` remembers."""

BITS = (np.arange(1 << 16)[:, None] >> np.arange(16) & 1).astype(np.int8)
"""The bits of each 16-bit mask, the lowest first, shape (65536, 16)."""

Floats = NDArray[np.float32]
"""Real numbers as observations hold them."""


class PlaceObservation(TypedDict):
    """What belongs to a stance, for N limbs on m points.

    Positions lie in the smallest box around the cabin and all points, widened by the robot's span
    on every side.
    """

    stance: IntArray
    """Point that each limb holds, 0 to m - 1, shape (N,), int64."""
    grasps: Floats
    """Positions x, y, z of these points one after the other [m], shape (3 N,), float32."""
    base_position: Floats
    """Base position [m], shape (3,), float32."""
    base_quaternion: Floats
    """Base orientation w, x, y, z with w >= 0, each from -1 to 1, shape (4,), float32."""


class Observation(PlaceObservation):
    """What an agent sees."""

    goal: Floats
    """Goal position of the base [m], shape (3,), float32; inside the cabin."""
    branches: NDArray[np.int8]
    """Branches and flips that each limb may still be on, 0 or 1, shape (16 N,), int8."""


def observation_space(graph: StanceGraph) -> spaces.Dict:
    """The space of `Observation`."""
    grasp_map, points, limbs = graph.grasp_map, len(graph.grasp_map), graph.limbs
    low = np.minimum(grasp_map.cabin[0], grasp_map.positions.min(axis=0)) - graph.robot.span
    high = np.maximum(grasp_map.cabin[1], grasp_map.positions.max(axis=0)) + graph.robot.span
    low, high = low.astype(np.float32), high.astype(np.float32)
    return spaces.Dict(
        {
            "stance": spaces.MultiDiscrete([points] * limbs),
            "grasps": spaces.Box(np.tile(low, limbs), np.tile(high, limbs), dtype=np.float32),
            "base_position": spaces.Box(low, high, dtype=np.float32),
            "base_quaternion": spaces.Box(-1.0, 1.0, (4,), dtype=np.float32),
            "goal": spaces.Box(low, high, dtype=np.float32),
            "branches": spaces.MultiBinary(16 * limbs),
        }
    )


def place_observation(
    graph: StanceGraph, stance: tuple[int, ...], place: Place
) -> PlaceObservation:
    """What belongs to a stance, in the posture of `place`."""
    return {
        "stance": np.array(stance, dtype=np.int64),
        "grasps": graph.grasp_map.positions[list(stance)].ravel().astype(np.float32),
        "base_position": np.array(place.base_in_world).astype(np.float32),
        "base_quaternion": place.quaternion.astype(np.float32),
    }


def observation(seen: PlaceObservation, state: State, goal: Array) -> Observation:
    """What an agent sees in a state, in new arrays."""
    return {
        "stance": seen["stance"].copy(),
        "grasps": seen["grasps"].copy(),
        "base_position": seen["base_position"].copy(),
        "base_quaternion": seen["base_quaternion"].copy(),
        "goal": goal.astype(np.float32),
        "branches": np.concatenate([BITS[mask] for mask in state.masks]),
    }


class Observer:
    """Tells what an agent sees, and remembers what belongs to a stance."""

    def __init__(self, graph: StanceGraph) -> None:
        """Start with no stance remembered."""
        self.graph = graph
        self._remembered: dict[tuple[int, ...], PlaceObservation] = {}

    def observation(self, state: State, place: Place, goal: Array) -> Observation:
        """What an agent sees in a state at `place`, in new arrays."""
        if state.pose is not None:
            return observation(place_observation(self.graph, state.stance, place), state, goal)
        seen = self._remembered.get(state.stance)
        if seen is None:
            if len(self._remembered) >= REMEMBERED:
                self._remembered.clear()
            seen = place_observation(self.graph, state.stance, place)
            self._remembered[state.stance] = seen
        return observation(seen, state, goal)


def stance_observations(graph: PairGraph) -> PlaceObservation:
    """What belongs to each of the n stances of a graph: arrays with a leading axis n."""
    return {
        "stance": graph.points.astype(np.int64),
        "grasps": graph.grasp_map.positions[graph.points].reshape(-1, 6).astype(np.float32),
        "base_position": graph.base_in_world.astype(np.float32),
        "base_quaternion": quaternion(graph.base_axes_in_world).astype(np.float32),
    }


def observations(
    rows: PlaceObservation, stances: IntArray, masks: IntArray, goals: Array
) -> Observation:
    """What k agents see: arrays with a leading axis k.

    Args:
        rows: What belongs to each stance, see `stance_observations`.
        stances: Stance indices, shape (k,).
        masks: Branches each limb may be on, shape (k, 2).
        goals: Goal positions [m], shape (k, 3).
    """
    bits = masks[:, :, None] >> np.arange(16) & 1
    return {
        "stance": rows["stance"][stances],
        "grasps": rows["grasps"][stances],
        "base_position": rows["base_position"][stances],
        "base_quaternion": rows["base_quaternion"][stances],
        "goal": goals.astype(np.float32),
        "branches": bits.reshape(len(stances), -1).astype(np.int8),
    }
