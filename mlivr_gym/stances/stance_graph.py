"""The stance graph: the stances that a robot can hold on a map, and the steps between them.

`build.stance_graph` makes one, for any number of limbs. That of two limbs lists all its stances;
with more limbs nodes are computed on demand, or read from a table that ships or was built.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from mlivr_gym.arguments import InstanceOf, checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.distances import CABIN, HANDRAIL, OBSTACLE, SELF, UNDECIDED
from mlivr_gym.compiled.limb_branch_sets import packed, unpacked
from mlivr_gym.errors import StanceError
from mlivr_gym.kinematics.limb import Angles, held_angles
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.postures.base_poses import OPPOSED_HEIGHTS, bases_at
from mlivr_gym.postures.given_pose import (
    branch_sets_of_joints,
    given_joints,
    given_pose,
    given_pose_fault,
    rotation_of,
)
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.relabelling import relabelled
from mlivr_gym.schema import ListOf, Numbers
from mlivr_gym.stances.checked_steps import Pieces, at_once, join
from mlivr_gym.stances.node_steps import candidate_steps
from mlivr_gym.stances.node_table import longest_step
from mlivr_gym.stances.stance_postures import StancePostures
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.transitions.rule import can_release
from mlivr_gym.transitions.state import State, Successors
from mlivr_gym.values import MAX_POINTS
from mlivr_gym.world.given_points import STANCE

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


class StanceGraph(StancePostures):
    """Stances and steps of one robot on one map under one set of thresholds."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy what the graph is made of, its world, and a table that no file has."""
        kind, made_of, world = super().__reduce__()
        found = None if self.graph_table is None else TABLES.find(self)
        is_stored = found is not None and found[0] is not None
        return kind, made_of, (*world, is_stored, None if is_stored else self.graph_table)

    def __setstate__(self, world: tuple[Any, ...]) -> None:
        """Take a world, and a table that is given or stored."""
        *rest, is_stored, table = world
        super().__setstate__(tuple(rest))
        found = TABLES.find(self) if is_stored else None
        self.graph_table = found[1] if found else table

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
        posture, pose = self.posture(self.indices(stance)), given_pose((position, quaternion))
        off = (
            np.abs(posture.base_position[0] - position).max(),
            np.abs(posture.base_rotation[0] - rotation_of(pose)).max(),
        )
        return None if max(off) < 1e-9 else pose

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

    def state(self, stance: Sequence[str | int], pose: Any = None, joints: Any = None) -> State:
        """Return the state of a robot that holds a stance.

        The base pose is x, y, z [m] and quaternion w, x, y, z, if it is not that of the stance's
        posture. The thresholds do not apply to it; the robot must reach its points, touch nothing
        and be able to depart. Joint angles have shape (N, 6) [rad], if the branch of each limb is
        given. Raises a `StanceError` if the stance cannot be held; the message has the reason, and
        a `SettingError` if the pose or the joint angles are not valid numbers.
        """
        points = self.indices(stance)
        base_pose = None if pose is None else given_pose(pose)
        angles = None if joints is None else given_joints(self.robot, joints)
        posture = self.posture(points) if base_pose is None else self._posture_at(points, base_pose)
        if not self.is_node(posture)[0]:
            fault = self._fault(points, posture, base_pose)
            raise StanceError(f"stance {self.ids(points)} cannot be held: {fault}")
        if angles is not None:
            return State(
                points, branch_sets_of_joints(self.solver, points, posture, angles), base_pose
            )
        return State(points, tuple(int(m) for m in posture.branch_sets[0]), base_pose)

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
        if self.obstacles and self.is_node(self.solver.solve(np.array([points]), nodes_only=True)):
            return f"its posture touches {TOUCHED[OBSTACLE]}"
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

    @checked(late=True)
    def step_to(self, state: State, after: tuple[int, ...]) -> State | None:
        """Return the state after the step to a stance, None without such a step."""
        return next(iter(self.states_along(state, [after])[1:]), None)

    def successors(self, state: State) -> Successors:
        """Return all steps that leave a state."""
        self.check(state)
        row, relabelling = (-1, 0) if state.pose is not None else self._row(state.stance)
        if row < 0 or self.table is None:
            return self.successors_by_pieces(state, at_once)
        moves = candidate_steps(self.present.table, row, -relabelling)
        points = relabelled(self.table.points[moves.rows].astype(np.int64), moves.relabellings)
        vacant = ~np.isin(points, list(self.occupied)).any(axis=1)
        vacant &= self.occupied.isdisjoint(state.stance)
        after = self._branch_sets_along(state, relabelling, moves.edges[vacant])
        after = relabelled(after, moves.relabellings[vacant])
        kept = after.all(axis=1)
        rows, points, limb = (one[vacant][kept] for one in (moves.rows, points, moves.limb))
        base = self.table.base_position[rows]
        if not self.lists_all:  # positions of other tables are rounded
            stances = self.table.points[rows].astype(np.int64)
            pose_number = self.table.pose_number[rows].astype(np.int64)
            base, _ = bases_at(self.grasp_map, self.robot, stances, pose_number)
        return Successors(limb, points[np.arange(len(limb)), limb], base, after[kept])

    def _branch_sets_along(self, state: State, relabelling: int, edges: IntArray) -> IntArray:
        """Return branch sets after edges of the table that leave a state, (k, N); 0 for no step.

        The relabelling is that of the state to its node; the result is labelled as the table is.
        """
        present, before = self.present, np.array([state.branch_sets], dtype=np.int64)
        sets = np.repeat(packed(relabelled(before, np.array([relabelling]))), len(edges))
        return unpacked(present.branch_sets_after(edges, sets, present.kept(edges)), self.limbs)

    @checked(late=True)
    def states_along(self, state: State, stances: Sequence[tuple[int, ...]]) -> tuple[State, ...]:
        """Return a state and those after steps from it to stances in turn, as far as these go.

        There are fewer than k + 1 states for k stances if one of them cannot be held, or no step
        leads to it from the one before.
        """
        self.check(state)
        states = [state]
        for stance in stances:
            self.check_stance(stance)
            after = self._state_after(states[-1], tuple(stance))
            if after is None:
                break
            states.append(after)
        return tuple(states)

    def _state_after(self, state: State, after: tuple[int, ...]) -> State | None:
        """Return the state after the step to a stance, None without such a step."""
        moves = np.array(after) != state.stance
        if moves.sum() != 1 or not self.occupied.isdisjoint((*state.stance, *after)):
            return None
        limb, (row, relabelling) = int(moves.argmax()), self._row(state.stance)
        if state.pose is not None or row < 0 or self.table is None:
            return self.state_after(state, after, join(self.posture_of(state), self.posture(after)))
        steps = candidate_steps(self.present.table, row, -relabelling)
        points = relabelled(self.table.points[steps.rows].astype(np.int64), steps.relabellings)
        there = np.flatnonzero((steps.limb == limb) & (points[:, limb] == after[limb]))
        found = self._branch_sets_along(state, relabelling, steps.edges[there])
        found = relabelled(found, steps.relabellings[there])
        return State(after, tuple(found[0].tolist())) if found.all(axis=1).any() else None

    @checked(late=True)
    def releasable_after(self, state: State, steps: Successors) -> BoolArray:
        """Return whether a support limb could be released after each step, shape (k,).

        It is assumed if not all stances are listed, since releases take long to compute.
        """
        self.check(state)
        if not self.lists_all or not self.settings.transitions:
            return np.ones(len(steps.limb), dtype=np.bool_)
        stances = steps.stances(state)
        releasable = (
            self.all_releases(stances, self.postures(stances))["branches"] & steps.branch_sets
        )
        releasable[np.arange(len(stances)), steps.limb] = 0
        return np.asarray(releasable.any(axis=1))

    def neighbouring_nodes(
        self, stance: tuple[int, ...], pieces: Pieces = at_once
    ) -> tuple[IntArray, Postures]:
        """Return the nodes one move from a stance, shape (k, N), and their postures.

        They are computed in the pieces that `pieces` yields.
        """
        self.check_stance(stance)
        stances = self._neighbouring(stance, range(self.limbs))
        found = [self.nodes(stances[piece]) for piece in pieces("postures", len(stances))]
        postures = join(self.nodes(stances[:0]), *found)
        node = self.is_node(postures)
        return stances[node], postures.take(node)

    def neighbours(self, state: State, posture: Postures) -> IntArray:
        """Return the stances one step from a state by limbs that can be released, (k, N).

        Neither their postures nor the steps to them are checked.
        """
        releasable = [
            limb
            for limb in range(self.limbs)
            if not self.settings.transitions
            or can_release(
                state.branch_sets[limb], self.releasable_branches(state.stance, posture, limb)
            )
        ]
        return self._neighbouring(state.stance, releasable)

    def _neighbouring(self, stance: tuple[int, ...], limbs: Iterable[int]) -> IntArray:
        """Return the stances after moves of some limbs to points that their others allow, (k, N).

        Stances that are no nodes by the table are omitted.
        """
        after = [np.zeros((0, self.limbs), dtype=np.int64)]
        for limb in limbs:
            others = [point for i, point in enumerate(stance) if i != limb]
            compatible = np.flatnonzero(self.compatible[others].all(axis=0))
            compatible = compatible[compatible != stance[limb]]
            after.append(np.tile(np.array(stance, dtype=np.int64), (len(compatible), 1)))
            after[-1][:, limb] = compatible
        stances = np.concatenate(after)
        if self.table is None:
            return stances
        return np.asarray(stances[self.table.find(stances, self.robot)[0] >= 0])

    def likely_base(self, stances: IntArray) -> Array:
        """Return a likely base position at stances, shape (k, N) -> (k, 3) [m].

        It lies above the centroid of the grasps at the mean height; the posture may have another.
        """
        positions, normals = self.grasp_map.positions[stances], self.grasp_map.normals[stances]
        height = float(np.mean(self.robot.heights))
        likely: Array = positions.mean(axis=1) + height * normals.mean(axis=1)
        return likely

    @cached_property
    def max_displacement(self) -> float:
        """An upper bound of the base displacement of one step [m].

        If all stances are listed, it is the largest one of two that share all points but one.
        Otherwise: the supports stay where they are, and each is within reach of the base before and
        after. Also the centroid of the grasps moves at most `2 span / N`, and the base is at most
        the largest height from it.
        """
        if self.lists_all:
            assert self.table is not None
            return max(longest_step(self.table), 1e-9)
        robot = self.robot
        height = max(max(map(abs, robot.heights)), max(OPPOSED_HEIGHTS))
        by_reach = 2.0 * robot.reach
        return min(by_reach, 2.0 * robot.span / self.limbs + 2.0 * height)
