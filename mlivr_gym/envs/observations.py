"""Observations of the single and the vector environment, and their space."""

from __future__ import annotations

from typing import NamedTuple, NotRequired, TypedDict, cast

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import has
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.stances.moves import StanceProperties
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

BRANCH_BITS = (np.arange(1 << 16)[:, None] >> np.arange(16) & 1).astype(np.int8)
"""Bits of each 16-bit branch set, the lowest first, shape (65536, 16)."""

Floats = NDArray[np.float32]
"""Array of real numbers in single precision, as in observations."""


class Observation(TypedDict):
    """Observation of an agent, for N limbs and m graspable points.

    Positions lie in the smallest box around the cabin and all points, widened by the robot's span
    on every side.
    """

    stance: IntArray
    """Index of the point that each limb holds, 0 to m - 1, shape (N,), int64."""
    grasps: Floats
    """Positions x, y, z of these points, limb by limb [m], shape (3 N,), float32."""
    base_position: Floats
    """Position of the base [m], shape (3,), float32."""
    base_quaternion: Floats
    """Orientation of the base w, x, y, z, with w >= 0, each from -1 to 1, shape (4,), float32."""
    goal: Floats
    """Goal position of the base [m], shape (3,), float32; it lies inside the cabin."""
    branches: NDArray[np.int8]
    """Whether each limb may be on each branch and flip, limb by limb, at `branch + 8 flip`, shape
    (16 N,), int8."""
    occupied: NotRequired[NDArray[np.int8]]
    """Whether each point is occupied, shape (m,), int8; only with `LayoutTasks` or in
    `ClosedLoopEnv`."""
    unknown: NotRequired[NDArray[np.int8]]
    """Whether each point was not seen yet, shape (m,), int8; only in `UnknownMapEnv`."""
    obstacles: NotRequired[NDArray[np.int8]]
    """Whether an obstacle is believed in each cell, shape (nx, ny, nz), int8; only in
    `ClosedLoopEnv`."""


FIELDS = tuple(Observation.__annotations__)
"""Names of the parts of an observation."""


@checked()
def observation_space(graph: StanceGraph, layouts: bool = False) -> spaces.Dict:
    """Return the space of `Observation`, with `occupied` if episodes have layouts of their own."""
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
            **({"occupied": spaces.MultiBinary(points)} if layouts else {}),
        }
    )


def observation_of(
    graph: StanceGraph, state: State, properties: StanceProperties, goal: Array, layouts: bool
) -> Observation:
    """Return the observation of a state, by the properties of its stance, in new arrays.

    With `layouts` it has `occupied`, as in `observation_space`.
    """
    stance, grasps, position, turn = properties.seen
    seen: Observation = {
        "stance": stance.copy(),
        "grasps": grasps.copy(),
        "base_position": position.copy(),
        "base_quaternion": turn.copy(),
        "goal": goal.astype(np.float32),
        "branches": BRANCH_BITS.take(state.branch_sets, axis=0).ravel(),
    }
    if layouts:
        seen["occupied"] = np.zeros(len(graph.grasp_map), dtype=np.int8)
        seen["occupied"][list(graph.occupied)] = 1
    return seen


class ObservationTable(NamedTuple):
    """Properties of the n stances of a two-limb graph on m points, for writing observations."""

    points: NDArray[np.int32]
    """Index of the point that each limb holds, shape (n, 2)."""
    positions: Array
    """Positions of the points [m], shape (m, 3)."""
    properties: Array
    """Base position [m], quaternion, limb and base manipulability, shape (n, 3 + 4 + 2 + 1)."""

    @classmethod
    def of(cls, graph: StanceGraph) -> ObservationTable:
        """Return the table of a graph."""
        turns = quaternion(graph.base_rotation)
        properties = np.column_stack([graph.base_position, turns, graph.w_m, graph.w_b])
        return cls(graph.points.astype(np.int32), graph.grasp_map.positions, properties)


class ObservationArrays(NamedTuple):
    """Observations of k sub-environments, with a leading axis k, and further numbers for `info`."""

    stance: IntArray
    grasps: Floats
    base_position: Floats
    base_quaternion: Floats
    goal: Floats
    branches: NDArray[np.int8]
    precise_base_position: Array
    """Positions of the bases in double precision [m], shape (k, 3)."""
    w_m: Array
    """Limb manipulability, shape (k, 2)."""
    w_b: Array
    """Base manipulability, shape (k,)."""
    goal_distance: Array
    """Distances of the bases from their goals [m], shape (k,)."""

    @classmethod
    def of(
        cls, table: ObservationTable, stances: IntArray, branch_sets: IntArray, goals: Array
    ) -> ObservationArrays:
        """Return the observations of k states, in new arrays.

        Stance indices have shape (k,), branch sets of both limbs (k, 2), goal positions (k, 3) [m].
        """
        k, reals = len(stances), np.float32
        made = cls(
            np.empty((k, 2), dtype=np.int64),
            np.empty((k, 6), dtype=reals),
            np.empty((k, 3), dtype=reals),
            np.empty((k, 4), dtype=reals),
            np.empty((k, 3), dtype=reals),
            np.empty((k, 32), dtype=np.int8),
            np.empty((k, 3)),
            np.empty((k, 2)),
            np.empty(k),
            np.empty(k),
        )
        write_observations(stances, branch_sets, goals, table, made)
        return made

    def observation(self) -> Observation:
        """Return the part that agents observe."""
        return cast(Observation, dict(zip(FIELDS, self[:6], strict=False)))


@entry
def write_observations(
    stances: IntArray,
    branch_sets: IntArray,
    goals: Array,
    table: ObservationTable,
    out: ObservationArrays,
) -> None:
    """Write the observations of k states; the arguments are those of `ObservationArrays.of`."""
    for k in range(len(stances)):  # reads of distant memory come first, so that they overlap
        s = stances[k]
        for limb in range(2):
            out.stance[k, limb] = table.points[s, limb]
            out.w_m[k, limb] = table.properties[s, 7 + limb]
        for axis in range(3):
            out.precise_base_position[k, axis] = table.properties[s, axis]
        for part in range(4):
            out.base_quaternion[k, part] = table.properties[s, 3 + part]
        out.w_b[k] = table.properties[s, 9]
    for k in range(len(stances)):
        square = 0.0
        for limb in range(2):
            point = out.stance[k, limb]
            for axis in range(3):
                out.grasps[k, 3 * limb + axis] = table.positions[point, axis]
            for branch in range(16):
                out.branches[k, 16 * limb + branch] = has(branch_sets[k, limb], branch)
        for axis in range(3):
            here, goal = out.precise_base_position[k, axis], goals[k, axis]
            out.base_position[k, axis], out.goal[k, axis] = here, goal
            square += (here - goal) ** 2
        out.goal_distance[k] = np.sqrt(square)
