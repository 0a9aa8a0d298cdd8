"""Features of the pointer network: points, actions and goal in the frame of the robot's base.

They depend neither on the number and order of the points nor on where in the module the robot is.
`env_features` computes them for any environment, `TableFeatures` for many states from exact tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation
from mlivr_gym.envs.wrappers import WRAPPED_ENV
from mlivr_gym.schema import OrNone
from mlivr_gym.sharing import Independent
from mlivr_gym.stances.stance_graph import STATES, StanceGraph
from mlivr_gym.stances.step_tables import StepTables
from mlivr_gym.stances.table_steps import LookaheadGoals, valid_positions, write_action_lookahead
from mlivr_gym.transitions.state import State, Successors
from mlivr_gym.world.grasp_map import GraspMap

Features = dict[str, NDArray[np.float32]]
"""Observations of the pointer policy by name, as `point_features` returns them."""

DEPTH = 4
"""Number of steps by which the lookahead of a point looks ahead of its grasp."""

POINT_FEATURES, LIMB_FEATURES, GOAL_FEATURES = 8, 8 + 4 * DEPTH, 5
"""Number of features of a point, of a limb and a point (an action), and of the goal."""

POINT_DISTANCES, POINT_ARRIVALS = slice(6, 6 + DEPTH), slice(6 + DEPTH, 6 + 2 * DEPTH)
"""Indices of the lookahead distances and arrivals of a point among its features for one limb."""

ACTION_DISTANCES = slice(POINT_ARRIVALS.stop, POINT_ARRIVALS.stop + DEPTH + 1)
ACTION_ARRIVALS = slice(ACTION_DISTANCES.stop, LIMB_FEATURES)
"""Indices of the lookahead distances and arrivals of the action that grasps the point."""

MAX_GOAL_DISTANCE = 10.0
"""Lookahead distance where no stance can be held, and the largest one otherwise [m]."""


class StateBatch(NamedTuple):
    """States of a robot with N limbs, k of them, and the results of their actions."""

    base: Array
    """Positions of the base [m], shape (k, 3)."""
    rotation: Array
    """Rotations of the base, shape (k, 3, 3)."""
    stance: IntArray
    """Indices of the points held, shape (k, N)."""
    valid: BoolArray
    """Whether each action is valid, shape (k, N, m)."""
    after: Array
    """Position of the base after each valid action [m], shape (k, N, m, 3); else undefined."""
    releasable_after: BoolArray
    """Whether a support limb can be released after each valid action, shape (k, N, m)."""
    lookahead: Array
    """Result of `action_lookahead` for each valid action, shape (k, N, m, 2 DEPTH + 2)."""


def point_features(
    grasp_map: GraspMap, risk: Array, states: StateBatch, goals: LookaheadGoals
) -> Features:
    """Return the features of k states with N limbs on m points, all in the frame of the base.

    `risk` is the probability that an attempt to grasp each point fails, shape (m,). What the goals
    say of points may be the same for all states: whether they are free, shape (m,), and the
    lookahead, (1, N, m, 2 DEPTH).

    `points` (k, m, 8): position, normal, whether the point is free, failure probability. `limbs`
    (k, N, m, 8 + 4 DEPTH), of the action of each limb and point: whether the limb holds the point,
    whether it can move there, the displacement of the base if it does, whether a support limb can
    be released then, the lookahead of the point, and the lookahead of the action; arrivals a are
    given as `log2(1 + a)`. `goal` (k, 5): position, distance, and goal tolerance.
    """
    base, rotation, valid = states.base, states.rotation, states.valid
    k, limbs = states.stance.shape
    m = len(grasp_map)
    point_part = np.empty((k, m, POINT_FEATURES), dtype=np.float32)
    point_part[:, :, :3] = np.matmul(grasp_map.positions[None] - base[:, None], rotation)
    point_part[:, :, 3:6] = np.matmul(grasp_map.normals[None], rotation)
    point_part[:, :, 6], point_part[:, :, 7] = goals.free, risk
    limb_part = np.zeros((k, limbs, m, LIMB_FEATURES), dtype=np.float32)
    limb_part[np.arange(k)[:, None], np.arange(limbs), states.stance, 0] = 1.0
    limb_part[..., 1] = valid
    state, limb, point = np.nonzero(valid)
    moved = states.after[state, limb, point] - base[state]
    limb_part[..., 5], limb_part[..., POINT_DISTANCES] = (
        valid & states.releasable_after,
        goals.of_points[..., :DEPTH],
    )
    limb_part[..., POINT_ARRIVALS] = np.log2(1.0 + goals.of_points[..., DEPTH:])
    of_action = states.lookahead[state, limb, point]
    limb_part[state, limb, point, ACTION_DISTANCES] = of_action[:, : DEPTH + 1]
    limb_part[state, limb, point, ACTION_ARRIVALS] = np.log2(1.0 + of_action[:, DEPTH + 1 :])
    limb_part[state, limb, point, 2:5] = np.einsum("ij,ijk->ik", moved, rotation[state])
    to_goal = np.einsum("ij,ijk->ik", goals.goals - base, rotation)
    distance = np.linalg.norm(to_goal, axis=1, keepdims=True)
    goal_part = np.concatenate([to_goal, distance, np.full_like(distance, goals.tolerance)], axis=1)
    return {"points": point_part, "limbs": limb_part, "goal": goal_part.astype(np.float32)}


def point_lookahead(
    graph: StanceGraph, goal: Array, tolerance: float, held: BoolArray | None = None
) -> Array:
    """Return how near to the goal the base may come after a limb grasps a point, and how often.

    The stances 1 to `DEPTH` steps after the grasp are considered, with the limbs moving in turn,
    the other one first, whether or not steps lead from one stance to the next. So the distances are
    lower bounds. With more than two limbs, whose stances are not enumerated, the distance is that
    of the point itself, and the arrivals are 0.

    The goal position [m] has shape (3,), its region the radius `tolerance` [m]; `held` is whether
    each stance can be held, shape (n,), by default as in the graph. The result has shape (N, m, 2
    DEPTH). Entry d < DEPTH is the minimum distance of the base from the goal d + 1 steps after the
    grasp [m], at most `MAX_GOAL_DISTANCE`. Entry DEPTH + d, the arrivals, is the number of
    sequences of d + 1 stances that end in the goal region.
    """
    if not graph.lists_all:
        away = np.minimum(
            np.linalg.norm(graph.grasp_map.positions - goal, axis=1), MAX_GOAL_DISTANCE
        )
        none = np.zeros((graph.limbs, len(away), 2 * DEPTH))
        none[..., :DEPTH] = away[None, :, None]
        return none
    held = (graph.branch_sets != 0).all(axis=1) if held is None else held
    rows, row_start = graph.by_point
    away = graph.base_position[rows] - goal
    distance = np.minimum(np.sqrt(np.einsum("ijk,ijk->ij", away, away)), MAX_GOAL_DISTANCE)
    lost = ~held[rows]
    out, count = (
        np.full((2, len(graph.grasp_map), DEPTH), MAX_GOAL_DISTANCE),
        (distance <= tolerance) * 1.0,
    )
    arrivals = np.zeros(out.shape)
    for depth in range(DEPTH):
        for limb in range(2):
            if depth:
                other = graph.points[rows[limb], 1 - limb]
                distance[limb] = out[1 - limb, other, depth - 1]
                count[limb] = arrivals[1 - limb, other, depth - 1]
            distance[limb, lost[limb]], count[limb, lost[limb]] = MAX_GOAL_DISTANCE, 0.0
            known = np.flatnonzero(np.diff(row_start[limb]))
            first = row_start[limb, known]
            out[limb, known, depth] = np.minimum.reduceat(distance[limb], first)
            arrivals[limb, known, depth] = np.add.reduceat(count[limb], first)
    return np.concatenate([out, arrivals], axis=2)


@checked({"states": OrNone(STATES)})
def env_features(env: MlivrEnv, states: Sequence[State] | None = None) -> Features:
    """Return the features of states of an environment, by default of its present state."""
    graph = env.graph
    states = [env.state] if states is None else states
    k, limbs, m = len(states), graph.limbs, len(graph.grasp_map)
    base, rotation = np.empty((k, 3)), np.empty((k, 3, 3))
    valid, after = np.zeros((k, limbs, m), dtype=np.bool_), np.zeros((k, limbs, m, 3))
    releasable_after = np.ones((k, limbs, m), dtype=np.bool_)
    of_points = point_lookahead(graph, env.goal, env.goal_tolerance)
    lookahead = np.zeros((k, limbs, m, 2 * DEPTH + 2))
    for row, state in enumerate(states):
        steps, posture = env.moves.successors(state), graph.posture_of(state)
        base[row], rotation[row] = posture.base_position[0], posture.base_rotation[0]
        valid[row, steps.limb, steps.point] = True
        after[row, steps.limb, steps.point] = steps.base_position
        releasable_after[row, steps.limb, steps.point] = env.moves.releasable_after(state, steps)
        lookahead[row, steps.limb, steps.point] = action_lookahead(env, state, steps, of_points)
    free = np.ones(m, dtype=np.bool_)
    free[list(graph.occupied)] = False
    stance = np.array([state.stance for state in states])
    return point_features(
        graph.grasp_map,
        env.failure_probability,
        StateBatch(base, rotation, stance, valid, after, releasable_after, lookahead),
        LookaheadGoals(np.tile(env.goal, (k, 1)), env.goal_tolerance, free, of_points[None]),
    )


def action_lookahead(env: MlivrEnv, state: State, steps: Successors, of_points: Array) -> Array:
    """Return the lookahead of each step: that of the points which valid actions grasp after it.

    This asks the model of the environment one step ahead. With more than two limbs, where computing
    all steps of a state takes long, the distance is that of the base after the step itself, and the
    arrivals are 0.

    `steps` are the k steps that leave the state, and `of_points` is the result of
    `point_lookahead`, shape (N, m, 2 DEPTH). The result has shape (k, 2 DEPTH + 2): minimum
    distance of the base from the goal after 1 to DEPTH + 1 further steps [m], and number of
    sequences of stances that end in the goal region.
    """
    out = np.zeros((len(steps.limb), 2 * DEPTH + 2))
    out[:, : DEPTH + 1] = MAX_GOAL_DISTANCE
    if not env.graph.lists_all:
        away = np.linalg.norm(steps.base_position - env.goal, axis=1)
        out[:, : DEPTH + 1] = np.minimum(away, MAX_GOAL_DISTANCE)[:, None]
        return out
    for k in range(len(out)):
        after = env.moves.successors(steps.after(state, k))
        if not len(after.limb):
            continue
        away = np.linalg.norm(after.base_position - env.goal, axis=1)
        following = of_points[after.limb, after.point]
        out[k, 0] = min(away.min(), MAX_GOAL_DISTANCE)
        out[k, 1 : DEPTH + 1] = following[:, :DEPTH].min(axis=0)
        out[k, DEPTH + 1] = np.count_nonzero(away <= env.goal_tolerance)
        out[k, DEPTH + 2 :] = following[:, DEPTH:].sum(axis=0)
    return out


class TableFeatures:
    """Function that computes the features of many states of one map from exact tables."""

    def __init__(self, env: MlivrEnv) -> None:
        """Take the map, the base rotations and the failures of an environment with two limbs."""
        self.grasp_map, self.rotation = (
            env.graph.grasp_map,
            env.table_moves().graph.base_rotation,
        )
        self.failure_probability, self.tolerance = env.failure_probability, env.goal_tolerance

    def __call__(
        self,
        tables: StepTables,
        stances: IntArray,
        branch_sets: IntArray,
        goals: Array,
        lookahead: Array,
        free: BoolArray | None = None,
    ) -> Features:
        """Return the features of k states.

        Stance indices have shape (k,), branch sets of both limbs (k, 2), goal positions (k, 3) [m].
        The tables hold all steps for all points of the map; `lookahead` is the result of
        `point_lookahead` for each state, shape (k, 2, m, 2 DEPTH). Whether each point may be
        grasped has shape (m,) or (k, m); by default all may.
        """
        k, m = len(stances), len(self.grasp_map)
        valid, after = np.zeros((k, 2, m), dtype=np.int8), np.zeros((k, 2, m, 3))
        releasable_after = np.zeros((k, 2, m), dtype=np.int8)
        valid_positions(stances, branch_sets, tables, valid, after, releasable_after)
        free = np.broadcast_to(np.True_ if free is None else free, (k, m))
        valid &= free[:, None]
        of_actions = np.zeros((k, 2, m, 2 * DEPTH + 2))
        of_actions[..., : DEPTH + 1] = MAX_GOAL_DISTANCE
        ahead = LookaheadGoals(goals, self.tolerance, np.ascontiguousarray(free), lookahead)
        write_action_lookahead(stances, branch_sets, tables, ahead, of_actions)
        states = StateBatch(
            tables.base_position[stances],
            self.rotation[stances],
            tables.points[stances].astype(np.int64),
            valid.view(np.bool_),
            after,
            releasable_after.view(np.bool_),
            of_actions,
        )
        return point_features(self.grasp_map, self.failure_probability, states, ahead)


class PointObservation(
    Independent, gymnasium.ObservationWrapper[Any, Any, Any], gymnasium.utils.RecordConstructorArgs
):
    """Wrapper whose observations are the features of the pointer network, `point_features`.

    Examples
    --------
    >>> env = PointObservation(gymnasium.make("mlivr_gym:MLIVR-JEM-v0"))
    >>> observation, info = env.reset(seed=0)
    >>> {name: array.shape for name, array in observation.items()}
    {'points': (331, 8), 'limbs': (2, 331, 24), 'goal': (5,)}
    """

    @checked({"env": WRAPPED_ENV})
    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        """Wrap a `MlivrEnv`; raise a `SettingError` if the environment is none."""
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        inner = env.unwrapped
        assert isinstance(inner, MlivrEnv)
        self.observation_space = point_space(inner)

    @checked()
    def observation(self, observation: Observation) -> Features:
        """Return the features of the present state, without a batch axis."""
        inner = self.env.unwrapped
        assert isinstance(inner, MlivrEnv)
        return {name: array[0] for name, array in env_features(inner).items()}

    def action_masks(self) -> BoolArray:
        """Return which actions are valid, shape (N m,), as `MaskablePPO` requires."""
        mask: BoolArray = self.env.get_wrapper_attr("action_masks")()
        return mask


def point_space(env: MlivrEnv) -> spaces.Dict:
    """Return the space of `point_features` for an environment."""
    m, limbs = len(env.graph.grasp_map), env.graph.limbs
    shapes = {
        "points": (m, POINT_FEATURES),
        "limbs": (limbs, m, LIMB_FEATURES),
        "goal": (GOAL_FEATURES,),
    }
    return spaces.Dict(
        {name: spaces.Box(-100.0, 100.0, shape, np.float32) for name, shape in shapes.items()}
    )
