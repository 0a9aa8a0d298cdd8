"""The stance graph: the stances that a robot can hold on a map, and the steps between them.

`build.stance_graph` makes one: for two limbs a `TwoLimbGraph`, which holds all stances; for more
limbs an `ImplicitGraph`, which computes them on demand.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.distances import CABIN, HANDRAIL, OBSTACLE, SELF, UNDECIDED
from mlivr_gym.errors import RobotError, StanceError, shortened
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.postures.given_pose import (
    branch_sets_of_joints,
    given_joints,
    given_pose,
    given_pose_fault,
    rotation_of,
)
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath, ListOf, Numbers
from mlivr_gym.settings import Settings
from mlivr_gym.stances.checked_steps import CheckedSteps, at_once, join
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.point_pairs import check_distances, nearest_told, pairs_within
from mlivr_gym.transitions.state import State, Successors, check_integers, check_state
from mlivr_gym.values import MAX_POINTS
from mlivr_gym.world.given_points import STANCE
from mlivr_gym.world.grasp_map import GraspMap

TOUCHED = {
    UNDECIDED: "something",
    SELF: "the robot itself",
    CABIN: "the cabin",
    HANDRAIL: "a handrail",
    OBSTACLE: "an obstacle",
}
"""Causes of collisions as parts of a sentence."""


STATES = ListOf(InstanceOf(State), 1, MAX_POINTS)
"""Validator of some states."""


class StanceGraph(CheckedSteps):
    """Stances and steps of one robot on one map under one set of thresholds."""

    solver_class: type[PostureSolver] = PostureSolver
    """Class of the posture solver."""
    table: NodeTable | None = None
    """Node table of the graph without obstacles and occupied points; None if there is none."""

    @checked()
    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Prepare the solver."""
        super().__init__(grasp_map, robot, settings, self.solver_class(grasp_map, robot, settings))
        self.limb_threshold, self.base_threshold = settings.thresholds(robot.limbs)

    @cached_property
    def pairs(self) -> IntArray:
        """Ordered pairs of points that may be held at once, shape (p, 2).

        Raises a `RobotError` if there is none.
        """
        grasp_map, robot = self.grasp_map, self.robot
        positions, pairs = grasp_map.positions, pairs_within(grasp_map, robot.span)
        distance = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
        pairs = pairs[distance >= robot.grasp_separation - 1e-9]
        if not len(pairs):
            raise RobotError(
                f"robot {robot.name!r} cannot hold any stance on map {grasp_map.name!r}: no two of "
                f"its points are between {robot.grasp_separation:g} m and {robot.span:g} m apart"
                f"{nearest_told(grasp_map, robot.span)}"
            )
        both = np.concatenate([pairs, pairs[:, ::-1]])
        ordered: IntArray = both[np.lexsort((both[:, 1], both[:, 0]))]
        return ordered

    @cached_property
    def partner_start(self) -> IntArray:
        """First pair of each point, and the end of all, shape (m + 1,)."""
        start: IntArray = np.searchsorted(self.pairs[:, 0], np.arange(len(self.grasp_map) + 1))
        return start

    @cached_property
    def compatible(self) -> BoolArray:
        """Which points two limbs may hold at once, shape (m, m)."""
        compatible = np.zeros((len(self.grasp_map),) * 2, dtype=np.bool_)
        compatible[tuple(self.pairs.T)] = True
        return compatible

    def partners(self, point: int) -> IntArray:
        """Return the points that may be held at once with `point`."""
        first = self.grasp_map.index(point)
        return self.pairs[self.partner_start[first] : self.partner_start[first + 1], 1]

    def indices(self, stance: Sequence[str | int]) -> tuple[int, ...]:
        """Return the point indices of a stance given by ids or indices.

        Raises a `StanceError` if the number of points, an id, or the distance of two points is not
        valid.
        """
        named = STANCE.read(stance, FieldPath("stance", StanceError))
        if len(named) != self.limbs:
            raise StanceError(
                f"stance {shortened(stance)} must name {self.limbs} points, one for each limb of "
                f"{self.robot.name!r}"
            )
        points = tuple(self.grasp_map.index(point) for point in named)
        check_distances(self.grasp_map, self.robot, points)
        return points

    def ids(self, stance: Sequence[int]) -> tuple[str, ...]:
        """Return the point ids of a stance."""
        named = STANCE.read(stance, FieldPath("stance", StanceError))
        return tuple(self.grasp_map.ids[self.grasp_map.index(point)] for point in named)

    def postures(self, stances: IntArray) -> Postures:
        """Return the postures of stances, shape (k, N), feasible or not.

        Stances that touch an obstacle or hold an occupied point cannot be held. Raises a
        `StanceError` if they are not rows of N point indices.
        """
        rows = self.rows_of_points(stances)
        return self.among_obstacles(rows, self.solver.solve(rows))

    def nodes(self, stances: IntArray) -> Postures:
        """Return postures as `postures` does, but only empty branch sets for what is no node."""
        rows = self.rows_of_points(stances)
        return self.among_obstacles(rows, self.solver.solve(rows, nodes_only=True))

    def rows_of_points(self, stances: Any) -> IntArray:
        """Check that stances are rows of point indices, see `postures`, and return them, (k, N)."""
        m = len(self.grasp_map)
        try:
            rows = np.asarray(stances)
        except ValueError:  # rows of different lengths
            rows = np.zeros(0)
        inside = rows.dtype.kind in "iu" and rows.shape[1:] == (self.limbs,)
        if not inside or not ((rows >= 0) & (rows < m)).all():
            raise StanceError(
                f"stances {shortened(stances)} must be rows of {self.limbs} point indices "
                f"from 0 to {m - 1}"
            )
        return rows.astype(np.int64)

    def check(self, state: State) -> None:
        """Check that a state is one of this map.

        Raises a `StanceError` if its stance or branch sets are not numbers of points and branches,
        and a `SettingError` if its base pose is not valid.
        """
        check_state(state, self.limbs, len(self.grasp_map))
        if state.pose is not None:
            given_pose(state.pose)

    def check_stance(self, stance: Sequence[int]) -> None:
        """Check that a stance has a point index for each limb, see `check`."""
        check_integers(stance, self.limbs, len(self.grasp_map) - 1, "stance")

    def posture(self, stance: Sequence[int]) -> Postures:
        """Return the posture of a stance given by point indices; arrays have a leading 1."""
        self.check_stance(stance)
        return self.postures(np.array([stance], dtype=np.int64))

    def is_node(self, postures: Postures) -> BoolArray:
        """Return which stances are nodes of the graph, given by their postures, shape (k,)."""
        node: BoolArray = np.all(postures.branch_sets > 0, axis=1)
        return node

    def posture_of(self, state: State) -> Postures:
        """Return the posture of a state: that of its stance, or the pose that a user gave."""
        self.check(state)
        if state.pose is None:
            return self.posture(state.stance)
        return self._posture_at(state.stance, state.pose)

    @checked({"stance": STANCE, "position": Numbers((3,)), "quaternion": Numbers((4,))})
    def given_pose_of(
        self, stance: Sequence[str | int], position: Array, quaternion: Array
    ) -> tuple[float, ...] | None:
        """Return a base pose as `state` reads it, None if it is that of the stance."""
        posture = self.posture(self.indices(stance))
        off = (
            np.abs(posture.base_position[0] - position).max(),
            np.abs(posture.base_rotation[0] - rotation_of((0, 0, 0, *quaternion))).max(),
        )
        return None if max(off) < 1e-9 else given_pose((position, quaternion))

    @checked({"states": STATES})
    def postures_of(self, states: Sequence[State]) -> Postures:
        """Return the postures of k states."""
        if all(state.pose is None for state in states):
            for state in states:
                self.check(state)
            return self.postures(np.array([state.stance for state in states], dtype=np.int64))
        return join(*(self.posture_of(state) for state in states))

    def _posture_at(self, points: tuple[int, ...], pose: tuple[float, ...]) -> Postures:
        """Return the posture of a stance at a given base pose, see `postures_at`."""
        where = np.array([pose[:3]]), rotation_of(pose)[None]
        return self.postures_at(np.array([points], dtype=np.int64), *where)

    def postures_at(
        self,
        stances: IntArray,
        positions: Array,
        rotations: Array,
        thresholds: tuple[float, float] = (0.0, 0.0),
    ) -> Postures:
        """Return postures at given base poses, among obstacles and occupied points.

        Stances have shape (k, N), base positions in the world shape (k, 3) [m], base rotations
        shape (k, 3, 3); the thresholds are those of `w_m` and `w_b`.
        """
        postures = self.solver.at(stances, positions, rotations, thresholds=thresholds)
        return self.among_obstacles(stances, postures)

    def state(self, stance: Sequence[str | int], pose: Any = None, joints: Any = None) -> State:
        """Return the state of a robot that holds a stance.

        The base pose is x, y, z [m] and quaternion w, x, y, z, if it is not that of the stance's
        posture. The thresholds do not apply to it; the robot must reach its points, touch nothing
        and be able to depart. Joint angles have shape (N, 6) [rad], if the branch of each limb is
        given. Raises a `StanceError` if the stance cannot be held; the message has the reason, and
        a `SettingError` if the pose or the joint angles are not valid numbers.
        """
        points = self.indices(stance)
        here = None if pose is None else given_pose(pose)
        angles = None if joints is None else given_joints(self.robot, joints)
        posture = self.posture(points) if here is None else self._posture_at(points, here)
        if not self.is_node(posture)[0]:
            raise StanceError(
                f"stance {self.ids(points)} cannot be held: {self._fault(points, posture, here)}"
            )
        if angles is not None:
            return State(points, branch_sets_of_joints(self.solver, points, posture, angles), here)
        return State(points, tuple(int(m) for m in posture.branch_sets[0]), here)

    def validated_state(self, state: State) -> State:
        """Check that a state of a user is one of this graph, and return it.

        Raises a `StanceError` with the reason if it is not.
        """
        self.check(state)
        known = self.state(state.stance, state.pose)
        branch_sets = tuple(map(int, state.branch_sets))
        if len(branch_sets) != self.limbs or any(
            not 0 < one & every == one
            for one, every in zip(branch_sets, known.branch_sets, strict=True)
        ):
            raise StanceError(
                f"state of stance {self.ids(known.stance)} has branch sets {branch_sets}; each "
                f"limb must be on some of {known.branch_sets}, on which it can hold"
            )
        return State(known.stance, branch_sets, known.pose)

    def _fault(
        self, points: tuple[int, ...], posture: Postures, pose: tuple[float, ...] | None = None
    ) -> str:
        """Return why a stance cannot be held, as the end of a sentence."""
        taken = [self.grasp_map.ids[p] for p in points if p in self.occupied]
        if taken:
            return f"point {taken[0]!r} is occupied"
        if pose is not None:
            return given_pose_fault(self.solver, points, posture, self.obstacles)
        cause = int(posture.cause[0])
        if cause:
            return f"every posture that meets the thresholds touches {TOUCHED[cause]}"
        w_m, w_b = posture.w_m[0], float(posture.w_b[0])
        if not posture.reachable[0]:
            return "the points are out of reach from every base pose tried"
        low = int(np.argmin(w_m))
        if w_m[low] < self.limb_threshold:
            return (
                f"limb manipulability {w_m[low]:.4f} of limb {low} is below the threshold "
                f"{self.limb_threshold:g}"
            )
        if w_b < self.base_threshold:
            return f"base manipulability {w_b:.6f} is below the threshold {self.base_threshold:g}"
        return (
            f"a limb could not depart along the surface normal with limb manipulability above "
            f"{self.settings.path_floor:g} and with every joint in its window"
        )

    def configuration(self, state: State) -> tuple[Array, Array, Array]:
        """Return a configuration of a state, each limb on its first branch and flip.

        These are base position [m], shape (3,), base quaternion w, x, y, z, and joint angles in
        their windows [rad], shape (N, 6).
        """
        posture = self.posture_of(state)
        bits = posture.branch
        if self.settings.transitions:
            bits = np.array([[(one & -one).bit_length() - 1 for one in state.branch_sets]])
        joints = self.joints(np.array([state.stance]), posture, bits)[0]
        return posture.base_position[0], quaternion(posture.base_rotation[0]), joints

    def joints(self, stances: IntArray, postures: Postures, bits: IntArray) -> Array:
        """Return the joint angles of k stances, in their windows, shape (k, N, 6) [rad].

        Stances have shape (k, N), as have branch and flip of each limb, `branch + 8 * flip`.
        """
        out, grasps = Angles.rows(*stances.shape), self.solver.grasps[stances]
        held_angles(self.checks.robots, postures.base_rows, grasps, bits, out)
        angles: Array = out["q"]
        return angles

    @checked(late=True)
    def state_after(self, state: State, after: Sequence[int], posture: Postures) -> State | None:
        """Return the state after a step, None if no such step leaves the state.

        `after` has the point index of each limb after the step, and `posture` the postures of the
        two stances, in this order.
        """
        self.check(state)
        self.check_stance(after)
        stance = tuple(after)
        here, there = (posture.take(slice(k, k + 1)) for k in range(2))
        first = np.zeros(1, int)
        found = self.branch_sets_after([state], here, first, np.array([stance]), there)[0]
        return State(stance, tuple(found.tolist())) if found.all() else None

    def successors(self, state: State) -> Successors:
        """Return all steps that leave a state."""
        self.check(state)
        return self.successors_by_pieces(state, at_once)

    @checked(late=True)
    def step_to(self, state: State, after: tuple[int, ...]) -> State | None:
        """Return the state after the step to a stance, None without such a step."""
        return next(iter(self.states_along(state, [after])[1:]), None)

    @checked(late=True)
    def states_along(self, state: State, stances: Sequence[tuple[int, ...]]) -> tuple[State, ...]:
        """Return a state and those after steps from it to stances in turn, as far as these go.

        There are fewer than k + 1 states for k stances if one of them cannot be held, or no step
        leads to it from the one before.
        """
        for stance in stances:
            self.check_stance(stance)
        here, states = self.posture_of(state), [state]
        points = np.array([state.stance, *stances], dtype=np.int64)
        postures = join(here, self.postures(points[1:])) if len(stances) else here
        moves, node = points[1:] != points[:-1], self.is_node(postures)
        able = (moves.sum(axis=1) == 1) & node[:-1] & node[1:]
        count = len(able) if able.all() else int(np.argmin(able))
        known, rows, limb = self.checks.stances(points, postures), np.arange(count), moves.argmax(1)
        if self.settings.transitions and self.settings.collisions:
            ends = np.stack([np.append(rows, rows + 1), np.tile(limb[:count], 2)], axis=1)
            self._check_releases(known, np.unique(ends, axis=0))
        for k in rows.tolist():
            found = postures.branch_sets[k + 1]
            if self.settings.transitions:
                before, branch_sets = rows[k : k + 1], np.array([states[-1].branch_sets])
                step = self.checks.steps(known, before, before + 1)
                found = self.branch_sets_of_steps(step, known, branch_sets)[0]
            if not found.all():
                break
            states.append(State(stances[k], tuple(found.tolist())))
        return tuple(states)

    @checked(late=True)
    def releasable_after(self, state: State, steps: Successors) -> BoolArray:
        """Return whether a support limb could be released after each step, shape (k,).

        It is assumed for more than two limbs, whose releases take long to compute.
        """
        self.check(state)
        return np.ones(len(steps.limb), dtype=np.bool_)

    @property
    @abstractmethod
    def max_displacement(self) -> float:
        """An upper bound of the base displacement of one step [m]."""
