"""The stance graph: which stances a robot can hold on a map, and which steps join them.

`build.stance_graph` makes one: for two limbs a `PairGraph`, which holds the whole feasible set; for
more a `LazyGraph`, which works neighbours out when they are asked for.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.distances import CABIN, HANDRAIL, OBSTACLE, SELF, UNDECIDED
from mlivr_gym.errors import RobotError, StanceError, shortened
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.postures.given_pose import (
    given_joints,
    given_pose,
    given_pose_fault,
    masks_of_joints,
    rotation_of,
)
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath
from mlivr_gym.settings import Settings
from mlivr_gym.stances.checked_steps import CheckedSteps, join
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.point_pairs import pairs_within
from mlivr_gym.transitions.state import State, Successors, check_integers, check_state
from mlivr_gym.world.grasp_map import STANCE, GraspMap

TOUCHED = {
    UNDECIDED: "something",
    SELF: "the robot itself",
    CABIN: "the cabin",
    HANDRAIL: "a handrail",
    OBSTACLE: "an obstacle",
}
"""What a cause of a collision is called in a sentence."""


class StanceGraph(CheckedSteps):
    """Stances and steps of one robot on one map under one set of thresholds."""

    solver_class: type[PostureSolver] = PostureSolver
    """What works postures out."""
    table: NodeTable | None = None
    """All stances that can be held and what is known of the steps between them, where there is such
    a table; without obstacles and occupied points."""
    has_tables: ClassVar[bool] = False
    """Whether the graph holds all its stances, so that tables of steps and costs can be made."""

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Prepare the solver and the pairs of points close enough to be held at once."""
        super().__init__(grasp_map, robot, settings, self.solver_class(grasp_map, robot, settings))
        self.limb_threshold, self.base_threshold = settings.thresholds(robot.limbs)
        positions = grasp_map.positions
        pairs = pairs_within(grasp_map, robot.span)
        distance = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
        pairs = pairs[distance >= robot.grasp_separation - 1e-9]
        if not len(pairs):
            raise RobotError(
                f"robot {robot.name!r} cannot hold any stance on map {grasp_map.name!r}: no two of "
                f"its points are between {robot.grasp_separation:g} m and {robot.span:g} m apart"
            )
        both = np.concatenate([pairs, pairs[:, ::-1]])
        self.pairs: IntArray = both[np.lexsort((both[:, 1], both[:, 0]))]
        """Ordered pairs of points that may be held at once, shape (p, 2)."""
        self.partner_start: IntArray = np.searchsorted(
            self.pairs[:, 0], np.arange(len(grasp_map) + 1)
        )

    @cached_property
    def together(self) -> BoolArray:
        """Which points may be held at once by two limbs, shape (m, m)."""
        together = np.zeros((len(self.grasp_map),) * 2, dtype=np.bool_)
        together[tuple(self.pairs.T)] = True
        return together

    def partners(self, point: int) -> IntArray:
        """Points that may be held together with `point`."""
        return self.pairs[self.partner_start[point] : self.partner_start[point + 1], 1]

    def indices(self, stance: Sequence[str | int]) -> tuple[int, ...]:
        """Point indices of a stance given by ids or indices.

        Raises
        ------
        StanceError
            If the number of points, an id, or the points' distance is wrong.
        """
        named = STANCE.read(stance, FieldPath("stance", StanceError))
        if len(named) != self.limbs:
            raise StanceError(
                f"stance {shortened(stance)} must name {self.limbs} points, one for each limb of "
                f"{self.robot.name!r}"
            )
        points = tuple(self.grasp_map.index(point) for point in named)
        for i, a in enumerate(points):
            for b in points[i + 1 :]:
                distance = float(
                    np.linalg.norm(self.grasp_map.positions[a] - self.grasp_map.positions[b])
                )
                names = f"{self.grasp_map.ids[a]!r} and {self.grasp_map.ids[b]!r}"
                if distance < self.robot.grasp_separation - 1e-9:
                    raise StanceError(
                        f"points {names} are {distance:.3f} m apart; two grippers need "
                        f"{self.robot.grasp_separation:g} m"
                    )
                if distance > self.robot.span + 1e-9:
                    raise StanceError(
                        f"points {names} are {distance:.3f} m apart; robot {self.robot.name!r} "
                        f"spans {self.robot.span:g} m"
                    )
        return points

    def ids(self, stance: Sequence[int]) -> tuple[str, ...]:
        """Point ids of a stance."""
        return tuple(self.grasp_map.ids[p] for p in stance)

    def postures(self, stances: IntArray) -> Postures:
        """Postures of stances, shape (k, N), feasible or not.

        Raises
        ------
        StanceError
            If they are not point indices in rows of N.
        """
        return self.solver.solve(self.rows_of_points(stances))

    def nodes(self, stances: IntArray) -> Postures:
        """As `postures`, but of stances that are no nodes only that, by masks of 0."""
        return self.solver.solve(self.rows_of_points(stances), nodes_only=True)

    def rows_of_points(self, stances: Any) -> IntArray:
        """Stances as point indices, shape (k, N); refuses others, see `postures`."""
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
        """Refuse what is no state on this map.

        Raises
        ------
        StanceError
            If its stance or masks are not numbers of points and branches.
        SettingError
            If it has a pose that is none.
        """
        check_state(state, self.limbs, len(self.grasp_map))
        if state.pose is not None:
            given_pose(state.pose)

    def check_stance(self, stance: Sequence[int]) -> None:
        """Refuse what is not a point index for each limb, as `check` does."""
        check_integers(stance, self.limbs, len(self.grasp_map) - 1, "stance")

    def posture(self, stance: Sequence[int]) -> Postures:
        """Posture of one stance given by point indices, every array with a leading 1."""
        self.check_stance(stance)
        return self.postures(np.array([stance], dtype=np.int64))

    def is_node(self, postures: Postures) -> BoolArray:
        """Which of some stances are nodes of the graph, shape (k,)."""
        node: BoolArray = np.all(postures.mask > 0, axis=1)
        return node

    def posture_of(self, state: State) -> Postures:
        """Posture in which a robot stands in a state: that of its stance, or a given one."""
        self.check(state)
        if state.pose is None:
            return self.posture(state.stance)
        return self._posture_at(state.stance, state.pose)

    def given_pose_of(
        self, stance: Sequence[str | int], position: Array, quaternion: Array
    ) -> tuple[float, ...] | None:
        """A base pose as `state` takes it, None if it is that of the stance's posture."""
        posture = self.posture(self.indices(stance))
        off = (
            np.abs(posture.base_position[0] - position).max(),
            np.abs(posture.base_rotation[0] - rotation_of((0, 0, 0, *quaternion))).max(),
        )
        return None if max(off) < 1e-9 else given_pose((position, quaternion))

    def postures_of(self, states: Sequence[State]) -> Postures:
        """Postures in which a robot stands in k states."""
        found = [self.posture_of(state) for state in states]
        return Postures(*(np.concatenate([getattr(p, name) for p in found]) for name in FIELDS))

    def _posture_at(self, points: tuple[int, ...], pose: tuple[float, ...]) -> Postures:
        """Posture of a stance at a given base pose, among present obstacles and occupied points."""
        where = np.array([pose[:3]]), rotation_of(pose)[None]
        return self.postures_at(np.array([points], dtype=np.int64), *where)

    def postures_at(
        self,
        stances: IntArray,
        positions: Array,
        rotations: Array,
        thresholds: tuple[float, float] = (0.0, 0.0),
    ) -> Postures:
        """Postures of stances at given base poses, among present obstacles and occupied points.

        Parameters
        ----------
        stances
            Point index of each limb, shape (k, N).
        positions
            Base positions in the world [m], shape (k, 3).
        rotations
            Base rotations in the world, shape (k, 3, 3).
        thresholds
            Least `w_m` and `w_b` they must meet.
        """
        postures = self.solver.at(stances, positions, rotations, thresholds=thresholds)
        if self.obstacles:
            self.clear_of_obstacles(np.arange(len(stances)), stances, postures)
        if self.occupied:
            postures.mask[np.isin(stances, sorted(self.occupied)).any(axis=1)] = 0
        return postures

    def state(self, stance: Sequence[str | int], pose: Any = None, joints: Any = None) -> State:
        """The state of a robot that takes hold of a stance.

        Parameters
        ----------
        stance
            Point id (or index) of each limb.
        pose
            Base pose, if the robot does not stand in the stance's posture: x, y, z [m] and
            quaternion w, x, y, z. The thresholds do not apply there; the robot must reach its
            points, touch nothing and be able to depart.
        joints
            Joint angles, shape (N, 6) [rad], if the branch of each limb is given.

        Raises
        ------
        StanceError
            If the stance cannot be held; the message says why.
        SettingError
            If pose or joint angles are no such numbers.
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
            return State(points, masks_of_joints(self.solver, points, posture, angles), here)
        return State(points, tuple(int(m) for m in posture.mask[0]), here)

    def checked_state(self, state: State) -> State:
        """A state that a user gives, as it is.

        Raises
        ------
        StanceError
            If it is no state of this graph; the message says why.
        """
        self.check(state)
        known = self.state(state.stance, state.pose)
        masks = tuple(map(int, state.masks))
        if len(masks) != self.limbs or any(
            not 0 < mask & held == mask for mask, held in zip(masks, known.masks, strict=True)
        ):
            raise StanceError(
                f"state of stance {self.ids(known.stance)} has masks {masks}; each limb must be "
                f"on some of {known.masks}, on which it can hold"
            )
        return State(known.stance, masks, known.pose)

    def _fault(
        self, points: tuple[int, ...], posture: Postures, pose: tuple[float, ...] | None = None
    ) -> str:
        """Why a stance cannot be held, as the end of a sentence."""
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
        """A configuration of a state, each limb on the first branch and flip that its mask allows.

        Returns
        -------
        tuple[Array, Array, Array]
            Base position [m], shape (3,), base quaternion w, x, y, z, and joint angles in their
            windows [rad], shape (N, 6).
        """
        posture = self.posture_of(state)
        bits = posture.branch
        if self.settings.transitions:
            bits = np.array([[(mask & -mask).bit_length() - 1 for mask in state.masks]])
        joints = self.joints(np.array([state.stance]), posture, bits)[0]
        return posture.base_position[0], quaternion(posture.base_rotation[0]), joints

    def joints(self, stances: IntArray, postures: Postures, bits: IntArray) -> Array:
        """Joint angles with which limbs hold k stances, in their windows, shape (k, N, 6) [rad].

        Parameters
        ----------
        stances
            Point index of each limb, shape (k, N).
        postures
            Their postures.
        bits
            Branch and flip of each limb, `branch + 8 * flip`, shape (k, N).
        """
        out, grasps = Angles.rows(*stances.shape), self.solver.grasps[stances]
        held_angles(self.checks.robots, postures.base_rows, grasps, bits, out)
        angles: Array = out["q"]
        return angles

    def transition(self, state: State, after: Sequence[int], posture: Postures) -> State | None:
        """The state after a step, or None if no such step leaves the state.

        Parameters
        ----------
        state
            The state before the step.
        after
            Point index of each limb after the step.
        posture
            Postures of the two stances, in this order.
        """
        stance = tuple(after)
        here, there = (posture.take(slice(k, k + 1)) for k in range(2))
        masks = self.masks_after([state], here, np.zeros(1, int), np.array([stance]), there)[0]
        return State(stance, tuple(masks.tolist())) if masks.all() else None

    @abstractmethod
    def candidates(self, stance: tuple[int, ...]) -> tuple[IntArray, IntArray, Postures]:
        """Feasible neighbouring stances of a stance, steps not yet checked.

        Returns
        -------
        tuple[IntArray, IntArray, Postures]
            Limb that moves, shape (k,), point that it moves to, shape (k,), and the postures after.
        """

    def successors(self, state: State) -> Successors:
        """All steps that leave a state."""
        self.check(state)
        limb, point, postures = self.candidates(state.stance)
        stances = np.tile(np.array(state.stance, dtype=np.int64), (len(limb), 1))
        stances[np.arange(len(limb)), limb] = point
        every = np.zeros(len(stances), dtype=np.int64)
        masks = self.masks_after([state], self.posture_of(state), every, stances, postures)
        kept = masks.all(axis=1)
        return Successors(limb[kept], point[kept], postures.base_position[kept], masks[kept])

    def step_to(self, state: State, after: tuple[int, ...]) -> State | None:
        """The state after the step to a neighbouring stance, None if there is no such step."""
        both = join(self.posture_of(state), self.posture(after))
        if after == state.stance:
            return None
        return self.transition(state, after, both) if self.is_node(both).all() else None

    def releasable_after(self, state: State, steps: Successors) -> BoolArray:
        """Whether a limb that holds could be released after each step, shape (k,).

        Taken for granted with more than two limbs, where the answer takes long.
        """
        return np.ones(len(steps.limb), dtype=np.bool_)

    @property
    @abstractmethod
    def max_step(self) -> float:
        """An upper bound of the base displacement of one step [m]."""
