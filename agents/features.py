"""What the point-wise policy sees: points, limbs and goal in the robot's frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import StepTables
from mlivr_gym.stances.table_steps import Ahead, legal_positions, onward_of_actions
from mlivr_gym.transitions.state import State, Successors

Features = dict[str, NDArray[np.float32]]
"""Observations of the point-wise policy by name, as `point_features` returns them."""

DEPTH = 4
"""Steps that the reach of a point looks ahead."""

POINT, LIMB, GOAL = 8, 8 + 4 * DEPTH, 5
"""Numbers that describe a point, a point as seen by one limb, and the goal."""

REACH, ARRIVALS = slice(6, 6 + DEPTH), slice(6 + DEPTH, 6 + 2 * DEPTH)
"""Where the reach of a point and its arrivals stand among those of a point as seen by one limb."""

ONWARD_REACH = slice(ARRIVALS.stop, ARRIVALS.stop + DEPTH + 1)
ONWARD_ARRIVALS = slice(ONWARD_REACH.stop, LIMB)
"""Where those stand that an action has if a step that is possible after it comes next."""

FAR = 10.0
"""Reach of points that no stance has [m]."""


class Points(NamedTuple):
    """The m points of a map."""

    positions: Array
    """Positions [m], shape (m, 3)."""
    normals: Array
    """Surface normals, shape (m, 3)."""
    free: BoolArray
    """Which points may be grasped, shape (m,), or (k, m) where it differs between k states."""
    risk: Array
    """Probability that an attempt at each point fails, shape (m,)."""


class Situations(NamedTuple):
    """Where the robot with N limbs is in k states, and what its actions do."""

    base: Array
    """Base positions [m], shape (k, 3)."""
    rotation: Array
    """Base rotations, shape (k, 3, 3)."""
    stance: IntArray
    """Point indices, shape (k, N)."""
    legal: BoolArray
    """Which actions are possible, shape (k, N, m)."""
    after: Array
    """Base position after each possible action [m], shape (k, N, m, 3); else anything."""
    releasable_after: BoolArray
    """Whether a limb that holds could let go after each possible action, shape (k, N, m)."""
    onward: Array
    """Reach and arrivals through the steps possible after each, shape (k, N, m, 2 DEPTH + 2)."""


class Aims(NamedTuple):
    """Where k states shall lead."""

    goal: Array
    """Goal positions [m], shape (k, 3)."""
    tolerance: float
    """Radius of the goal region [m]."""
    reach: Array
    """What `reach_of_points` returns, shape (k, N, m, 2 DEPTH), or (1, N, m, 2 DEPTH) for all."""


def point_features(points: Points, states: Situations, aims: Aims) -> Features:
    """Features of k states with N limbs on m points, all in the robot's frame.

    Returns
    -------
    Features
        `points` (k, m, 8): position, normal, whether free, risk. `limbs` (k, N, m, 8 + 4 DEPTH):
        whether the limb holds the point, whether it may move there, the base's displacement if it
        does, whether a limb that holds could let go then, reach and arrivals of the point, and
        those of the action through the steps possible after it; arrivals as the logarithm to the
        base 2 of one more. `goal` (k, 5): where the goal lies, its distance, and the tolerance.
    """
    base, rotation, legal = states.base, states.rotation, states.legal
    k, limbs = states.stance.shape
    m = len(points.positions)
    looks = np.empty((k, m, POINT), dtype=np.float32)
    looks[:, :, :3] = np.matmul(points.positions[None] - base[:, None], rotation)
    looks[:, :, 3:6] = np.matmul(points.normals[None], rotation)
    looks[:, :, 6], looks[:, :, 7] = points.free, points.risk
    seen = np.zeros((k, limbs, m, LIMB), dtype=np.float32)
    seen[np.arange(k)[:, None], np.arange(limbs), states.stance, 0] = 1.0
    seen[..., 1] = legal
    state, limb, point = np.nonzero(legal)
    moved = states.after[state, limb, point] - base[state]
    seen[..., 5], seen[..., REACH] = legal & states.releasable_after, aims.reach[..., :DEPTH]
    seen[..., ARRIVALS] = np.log2(1.0 + aims.reach[..., DEPTH:])
    onward = states.onward[state, limb, point]
    seen[state, limb, point, ONWARD_REACH] = onward[:, : DEPTH + 1]
    seen[state, limb, point, ONWARD_ARRIVALS] = np.log2(1.0 + onward[:, DEPTH + 1 :])
    seen[state, limb, point, 2:5] = np.einsum("ij,ijk->ik", moved, rotation[state])
    toward = np.einsum("ij,ijk->ik", aims.goal - base, rotation)
    distance = np.linalg.norm(toward, axis=1, keepdims=True)
    ahead = np.concatenate([toward, distance, np.full_like(distance, aims.tolerance)], axis=1)
    return {"points": looks, "limbs": seen, "goal": ahead.astype(np.float32)}


def reach_of_points(
    graph: StanceGraph, goal: Array, tolerance: float, held: BoolArray | None = None
) -> Array:
    """How near to the goal the steps after a grasp can lead, and in how many sequences they arrive.

    It is told for 1 to `DEPTH` steps, over all stances that can be held, whether steps lead there
    or not, the limbs moving in turns. For more than two limbs the stances are not known
    beforehand: the distance is then that of the point itself, and the arrivals are none.

    Parameters
    ----------
    graph
        The stance graph.
    goal
        Goal position [m], shape (3,).
    tolerance
        Radius of the goal region [m].
    held
        Which stances can be held, shape (n,); by default those that the graph says.

    Returns
    -------
    Array
        Shape (N, m, 2 DEPTH): the least distance of the base [m], at most `FAR`, and the number
        of sequences of stances that end in the goal region.
    """
    if not isinstance(graph, PairGraph):
        away = np.minimum(np.linalg.norm(graph.grasp_map.positions - goal, axis=1), FAR)
        none = np.zeros((graph.limbs, len(away), 2 * DEPTH))
        none[..., :DEPTH] = away[None, :, None]
        return none
    held = (graph.mask != 0).all(axis=1) if held is None else held
    away = graph.steps.row_base - goal
    distance = np.minimum(np.sqrt(np.einsum("ijk,ijk->ij", away, away)), FAR)
    lost = ~held[graph.rows]
    out, count = np.full((2, len(graph.grasp_map), DEPTH), FAR), (distance <= tolerance) * 1.0
    arrivals = np.zeros(out.shape)
    for depth in range(DEPTH):
        for limb in range(2):
            if depth:
                other = graph.points[graph.rows[limb], 1 - limb]
                distance[limb] = out[1 - limb, other, depth - 1]
                count[limb] = arrivals[1 - limb, other, depth - 1]
            distance[limb, lost[limb]], count[limb, lost[limb]] = FAR, 0.0
            known = np.flatnonzero(graph.degree[limb])
            first = graph.row_start[limb, known]
            out[limb, known, depth] = np.minimum.reduceat(distance[limb], first)
            arrivals[limb, known, depth] = np.add.reduceat(count[limb], first)
    return np.concatenate([out, arrivals], axis=2)


def env_features(env: MlivrEnv, states: Sequence[State] | None = None) -> Features:
    """Features of states of an environment, by default of the present one: a batch of one."""
    graph = env.graph
    states = [env.state] if states is None else states
    k, limbs, m = len(states), graph.limbs, len(graph.grasp_map)
    base, rotation = np.empty((k, 3)), np.empty((k, 3, 3))
    legal, after = np.zeros((k, limbs, m), dtype=np.bool_), np.zeros((k, limbs, m, 3))
    releasable_after = np.ones((k, limbs, m), dtype=np.bool_)
    reach = reach_of_points(graph, env.goal, env.goal_tolerance)
    onward = np.zeros((k, limbs, m, 2 * DEPTH + 2))
    for row, state in enumerate(states):
        steps, posture = env.moves.successors(state), graph.posture_of(state)
        base[row], rotation[row] = posture.base_position[0], posture.base_rotation[0]
        legal[row, steps.limb, steps.point] = True
        after[row, steps.limb, steps.point] = steps.base_in_world
        releasable_after[row, steps.limb, steps.point] = env.moves.releasable_after(state, steps)
        onward[row, steps.limb, steps.point] = onward_of(env, state, steps, reach)
    free = np.ones(m, dtype=np.bool_)
    free[list(graph.occupied)] = False
    stance = np.array([state.stance for state in states])
    return point_features(
        Points(graph.grasp_map.positions, graph.grasp_map.normals, free, env.failure_probability),
        Situations(base, rotation, stance, legal, after, releasable_after, onward),
        Aims(np.tile(env.goal, (k, 1)), env.goal_tolerance, reach[None]),
    )


def onward_of(env: MlivrEnv, state: State, steps: Successors, reach: Array) -> Array:
    """Reach and arrivals of each step through the steps that are possible after it.

    With more than two limbs, where to work out all steps of a state takes long, the distance is
    that of the base after the step itself, and the arrivals are none.

    Parameters
    ----------
    env
        The environment.
    state
        The state.
    steps
        The k steps that leave it.
    reach
        What `reach_of_points` returns, shape (N, m, 2 DEPTH).

    Returns
    -------
    Array
        Shape (k, 2 DEPTH + 2): the least distance of the base to the goal after 1 to DEPTH + 1 more
        steps [m], and the number of sequences that end in the goal region.
    """
    out = np.zeros((len(steps.limb), 2 * DEPTH + 2))
    out[:, : DEPTH + 1] = FAR
    if env.graph.limbs > 2:
        away = np.linalg.norm(steps.base_in_world - env.goal, axis=1)
        out[:, : DEPTH + 1] = np.minimum(away, FAR)[:, None]
        return out
    for k in range(len(out)):
        after = env.moves.successors(steps.after(state, k))
        if not len(after.limb):
            continue
        away = np.linalg.norm(after.base_in_world - env.goal, axis=1)
        following = reach[after.limb, after.point]
        out[k, 0] = min(away.min(), FAR)
        out[k, 1 : DEPTH + 1] = following[:, :DEPTH].min(axis=0)
        out[k, DEPTH + 1] = np.count_nonzero(away <= env.goal_tolerance)
        out[k, DEPTH + 2 :] = following[:, DEPTH:].sum(axis=0)
    return out


class TableFeatures:
    """Features of many states of one map from exact tables."""

    def __init__(self, env: MlivrEnv) -> None:
        """Of an environment with two limbs."""
        self.grasp_map, self.rotation = (
            env.graph.grasp_map,
            env.table_moves().graph.base_axes_in_world,
        )
        self.risk, self.tolerance = env.failure_probability, env.goal_tolerance

    def __call__(
        self,
        tables: StepTables,
        stances: IntArray,
        masks: IntArray,
        goals: Array,
        reach: Array,
        free: BoolArray | None = None,
    ) -> Features:
        """Features of k states.

        Parameters
        ----------
        tables
            The steps, of all points.
        stances
            Stance indices, shape (k,).
        masks
            Branches each limb may be on, shape (k, 2).
        goals
            Goal positions [m], shape (k, 3).
        reach
            What `reach_of_points` returns for each state, shape (k, 2, m, 2 DEPTH).
        free
            Which points may be grasped, shape (m,) or (k, m); by default all.
        """
        k, m = len(stances), len(self.grasp_map)
        legal, after = np.zeros((k, 2, m), dtype=np.int8), np.zeros((k, 2, m, 3))
        releasable_after = np.zeros((k, 2, m), dtype=np.int8)
        legal_positions(stances, masks, tables, legal, after, releasable_after)
        free = np.broadcast_to(np.True_ if free is None else free, (k, m))
        legal &= free[:, None]
        onward = np.zeros((k, 2, m, 2 * DEPTH + 2))
        onward[..., : DEPTH + 1] = FAR
        ahead = Ahead(goals, self.tolerance, np.ascontiguousarray(free), reach)
        onward_of_actions(stances, masks, tables, ahead, onward)
        states = Situations(
            tables.base_in_world[stances],
            self.rotation[stances],
            tables.points[stances].astype(np.int64),
            legal.view(np.bool_),
            after,
            releasable_after.view(np.bool_),
            onward,
        )
        return point_features(
            Points(self.grasp_map.positions, self.grasp_map.normals, free, self.risk),
            states,
            Aims(goals, self.tolerance, reach),
        )


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

    def observation(self, observation: Observation) -> Features:
        """The features, without a batch axis."""
        inner = self.env.unwrapped
        assert isinstance(inner, MlivrEnv)
        return {name: array[0] for name, array in env_features(inner).items()}

    def action_masks(self) -> BoolArray:
        """Which actions are possible, for sb3-contrib."""
        mask: BoolArray = self.env.get_wrapper_attr("action_masks")()
        return mask


def point_space(env: MlivrEnv) -> spaces.Dict:
    """Space of `point_features` for an environment."""
    m, limbs = len(env.graph.grasp_map), env.graph.limbs
    shapes = {"points": (m, POINT), "limbs": (limbs, m, LIMB), "goal": (GOAL,)}
    return spaces.Dict(
        {name: spaces.Box(-100.0, 100.0, shape, np.float32) for name, shape in shapes.items()}
    )
