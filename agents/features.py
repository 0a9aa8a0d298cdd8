"""What the point-wise policy sees: points, limbs and goal in the robot's frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mlivr_gym.envs.batch import legal_places
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph, State
from mlivr_gym.stances.step_tables import StepTables

Array = NDArray[np.float64]
Features = dict[str, NDArray[np.float32]]

DEPTH = 3
"""Steps that the reach of a point looks ahead."""

POINT, LIMB, GOAL = 8, 6 + DEPTH, 5
"""Numbers that describe a point, a point as seen by one limb, and the goal."""

FAR = 10.0
"""Reach of points that no stance has [m]."""


def point_features(
    positions: Array, normals: Array, free: NDArray[np.bool_], risk: Array, base: Array,
    rotation: Array, stance: NDArray[np.int64],
    goal: Array, tolerance: float, legal: NDArray[np.bool_], after: Array, reach: Array,
    releasable_after: NDArray[np.bool_],
) -> Features:  # fmt: skip
    """Features of k states with N limbs on m points, all in the robot's frame.

    Args:
        positions: Positions of the points [m], shape (m, 3).
        normals: Surface normals, shape (m, 3).
        free: Which points may be grasped, shape (m,) or (k, m).
        risk: Probability that an attempt at each point fails, shape (m,).
        base: Base positions [m], shape (k, 3).
        rotation: Base rotations, shape (k, 3, 3).
        stance: Point indices, shape (k, N).
        goal: Goal positions [m], shape (k, 3).
        tolerance: Radius of the goal region [m].
        legal: Which actions are possible, shape (k, N, m).
        after: Base position after each possible action [m], shape (k, N, m, 3); anything for the
            others.
        reach: What `reach_of_points` returns [m], shape (k, N, m, DEPTH).
        onward: Whether a limb that holds could let go after each possible action, shape (k, N, m);
            anything for the others.

    Returns:
        `points` (k, m, 8): position, normal, whether free, risk. `limbs` (k, N, m, 6 + DEPTH):
        whether the limb holds the point, whether it may move there, the base's displacement if it
        does, whether a limb that holds could let go then, and the reach. `goal` (k, 5): where the
        goal lies, its distance, and the tolerance.
    """
    k, limbs = stance.shape
    m = len(positions)
    points = np.empty((k, m, POINT), dtype=np.float32)
    points[:, :, :3] = np.matmul(positions[None] - base[:, None], rotation)
    points[:, :, 3:6] = np.matmul(normals[None], rotation)
    points[:, :, 6], points[:, :, 7] = free, risk
    seen = np.zeros((k, limbs, m, LIMB), dtype=np.float32)
    seen[np.arange(k)[:, None], np.arange(limbs), stance, 0] = 1.0
    seen[..., 1] = legal
    state, limb, point = np.nonzero(legal)
    moved = after[state, limb, point] - base[state]
    seen[..., 5], seen[..., 6:] = legal & releasable_after, reach
    seen[state, limb, point, 2:5] = np.einsum("ij,ijk->ik", moved, rotation[state])
    toward = np.einsum("ij,ijk->ik", goal - base, rotation)
    distance = np.linalg.norm(toward, axis=1, keepdims=True)
    ahead = np.concatenate([toward, distance, np.full_like(distance, tolerance)], axis=1)
    return {"points": points, "limbs": seen, "goal": ahead.astype(np.float32)}


def reach_of_points(
    graph: StanceGraph, goal: Array, held: NDArray[np.bool_] | None = None
) -> Array:
    """Least distance to the goal that the base can have 1 to `DEPTH` steps after a limb took hold of a point [m], at most `FAR`.

    Over all stances that can be held, whether steps lead there or not, the limbs moving in turns.
    For more than two limbs the stances are not known beforehand; it is then the distance of the
    point itself.

    Args:
        graph: The stance graph.
        goal: Goal position [m], shape (3,).
        held: Which stances can be held, shape (n,); by default those that the graph says.

    Returns:
        Shape (N, m, DEPTH).
    """
    if not isinstance(graph, PairGraph):
        away = np.minimum(np.linalg.norm(graph.grasp_map.positions - goal, axis=1), FAR)
        return np.broadcast_to(away[None, :, None], (graph.limbs, len(away), DEPTH)).copy()
    held = (graph.mask != 0).all(axis=1) if held is None else held
    away = graph.row_position - goal
    distance = np.minimum(np.sqrt(np.einsum("ijk,ijk->ij", away, away)), FAR)
    lost = ~held[graph.rows]
    out = np.full((2, len(graph.grasp_map), DEPTH), FAR)
    for depth in range(DEPTH):
        for limb in range(2):
            if depth:
                other = graph.points[graph.rows[limb], 1 - limb]
                distance[limb] = out[1 - limb, other, depth - 1]
            distance[limb, lost[limb]] = FAR
            known = np.flatnonzero(graph.degree[limb])
            out[limb, known, depth] = np.minimum.reduceat(
                distance[limb], graph.row_start[limb, known]
            )
    return out


def env_features(env: MlivrEnv, states: Sequence[State] | None = None) -> Features:
    """Features of states of an environment, by default of the present one: a batch of one."""
    graph = env.graph
    states = [env.state] if states is None else states
    k, limbs, m = len(states), graph.limbs, len(graph.grasp_map)
    base, rotation = np.empty((k, 3)), np.empty((k, 3, 3))
    legal, after = np.zeros((k, limbs, m), dtype=np.bool_), np.zeros((k, limbs, m, 3))
    releasable_after = np.ones((k, limbs, m), dtype=np.bool_)
    for row, state in enumerate(states):
        steps, posture = env.moves.successors(state), graph.posture_of(state)
        base[row], rotation[row] = posture.position[0], posture.rotation[0]
        legal[row, steps.limb, steps.point] = True
        after[row, steps.limb, steps.point] = steps.position
        releasable_after[row, steps.limb, steps.point] = env.moves.releasable_after(state, steps)
    free = np.ones(m, dtype=np.bool_)
    free[list(graph.occupied)] = False
    return point_features(
        graph.grasp_map.positions, graph.grasp_map.normals, free, env.failure_probability, base,
        rotation,
        np.array([state.stance for state in states]), np.tile(env.goal, (k, 1)), env.goal_tolerance,
        legal, after,
        reach_of_points(graph, env.goal)[None], releasable_after,
    )  # fmt: skip


class TableFeatures:
    """Features of many states of one map from exact tables."""

    def __init__(self, env: MlivrEnv) -> None:
        """Of an environment with two limbs."""
        self.grasp_map, self.rotation = env.graph.grasp_map, env.table_moves().graph.rotation
        self.risk, self.tolerance = env.failure_probability, env.goal_tolerance

    def __call__(
        self,
        tables: StepTables,
        stances: NDArray[np.int64],
        masks: NDArray[np.int64],
        goals: Array,
        reach: Array,
        free: NDArray[np.bool_] | None = None,
    ) -> Features:
        """Features of k states.

        Args:
            tables: The steps, of all points.
            stances: Stance indices, shape (k,).
            masks: Branches each limb may be on, shape (k, 2).
            goals: Goal positions [m], shape (k, 3).
            reach: What `reach_of_points` returns for each state [m], shape (k, 2, m, DEPTH).
            free: Which points may be grasped, shape (m,) or (k, m); by default all.
        """
        k, m = len(stances), len(self.grasp_map)
        legal, after = np.zeros((k, 2, m), dtype=np.int8), np.zeros((k, 2, m, 3))
        releasable_after = np.zeros((k, 2, m), dtype=np.int8)
        legal_places(stances, masks, tables, legal, after, releasable_after)
        free = np.ones(m, dtype=np.bool_) if free is None else free
        legal &= free[..., None, :]
        return point_features(
            self.grasp_map.positions, self.grasp_map.normals, free, self.risk,
            tables.position[stances],
            self.rotation[stances], tables.points[stances].astype(np.int64), goals, self.tolerance,
            legal.view(np.bool_),
            after, reach, releasable_after.view(np.bool_),
        )  # fmt: skip


class PointObservation(
    gymnasium.ObservationWrapper[Any, Any, Any], gymnasium.utils.RecordConstructorArgs
):
    """Observations for the point-wise policy: `point_features` of the present state."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Wrap a `MlivrEnv`."""
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner = env.unwrapped
        assert isinstance(inner, MlivrEnv)
        self.observation_space = point_space(inner)

    def observation(self, observation: dict[str, NDArray[Any]]) -> Features:
        """The features, without a batch axis."""
        inner = self.env.unwrapped
        assert isinstance(inner, MlivrEnv)
        return {name: array[0] for name, array in env_features(inner).items()}

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are possible, for sb3-contrib."""
        mask: NDArray[np.bool_] = self.env.get_wrapper_attr("action_masks")()
        return mask


def point_space(env: MlivrEnv) -> spaces.Dict:
    """Space of `point_features` for an environment."""
    m, limbs = len(env.graph.grasp_map), env.graph.limbs
    shapes = {"points": (m, POINT), "limbs": (limbs, m, LIMB), "goal": (GOAL,)}
    return spaces.Dict(
        {name: spaces.Box(-100.0, 100.0, shape, np.float32) for name, shape in shapes.items()}
    )
