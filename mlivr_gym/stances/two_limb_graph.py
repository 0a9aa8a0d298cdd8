"""Stance graph of two limbs, all of whose nodes are computed at once.

The neighbours of a stance (a, b) are the other stances of row a of limb 0 and of row b of limb 1,
so no list of edges is stored. The edge table has, for each ordered pair of stances of a row, the
branches that the support limb keeps from one to the other; edges are checked on demand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.distances import CABIN, CLEAR, HANDRAIL, OBSTACLE, SELF
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.sharing import locked
from mlivr_gym.stances.checked_steps import Pieces, at_once, join
from mlivr_gym.stances.node_table import NodeTable
from mlivr_gym.stances.obstacles import OBSTACLE_CELL_EDGE, PositionCells
from mlivr_gym.stances.stance_graph import STATES, TOUCHED, StanceGraph
from mlivr_gym.stances.two_limb_edges import TwoLimbEdges, TwoLimbEdgesAmongObstacles
from mlivr_gym.stances.two_limb_nodes import two_limb_nodes
from mlivr_gym.stances.two_limb_steps import TwoLimbTable, longest_step
from mlivr_gym.stances.two_limb_table_file import COUNTS, TWO_LIMB_TABLES, TwoLimbStances
from mlivr_gym.transitions.records import StanceArrays
from mlivr_gym.transitions.rule import can_release
from mlivr_gym.transitions.state import State, Successors, moving_limb
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

REMOVED = {"self": (SELF,), "cabin": (CABIN, OBSTACLE), "handrail": (HANDRAIL,)}
"""Causes of collisions that remove a stance from the graph; obstacles are here those of the map."""
NO_STEPS: IntArray = np.zeros((0, 4), dtype=np.int64)


class TwoLimbGraph(StanceGraph):
    """All nodes of a robot with two limbs, and the edges between them.

    Attributes
    ----------
    points
        Point indices of each stance, shape (n, 2), in lexical order.
    base_position
        Base positions [m], shape (n, 3).
    base_rotation
        Base rotations, the axes in columns, shape (n, 3, 3).
    w_m
        Limb manipulability, shape (n, 2).
    w_b
        Base manipulability, shape (n,).
    branch
        Branch of each limb in the posture, shape (n, 2).
    pose_number
        Number of the candidate base pose, see `candidate_poses`, shape (n,).
    considered
        Number of ordered pairs of points that were checked.
    reachable
        Number of those that the limbs can reach.
    removed
        Number of those above the thresholds that collide, by cause.
    no_departure
        Number of those above the thresholds from which a limb cannot depart with `w_m` above
        `Settings.path_floor` and every joint in its window. If steps are checked, this floor
        also holds without thresholds.
    """

    @checked()
    def __init__(
        self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings,
        known: TwoLimbStances | None = None,
    ) -> None:  # fmt: skip
        """Take what is known, read stances and steps from a table, or compute the stances."""
        super().__init__(grasp_map, robot, settings)
        may_find = known is None and self.solver_class is PostureSolver
        found = TWO_LIMB_TABLES.find(self) if may_find else None
        self._is_from_file = found is not None
        known = known or (found[1] if found else self._computed())
        self.considered, self.reachable, self.no_departure, *removed = (
            known.counts[name] for name in COUNTS
        )
        self.removed = dict(zip(REMOVED, removed, strict=True))
        self.points, self._contents, chosen = known.points, known, known.postures
        self.base_position, self.base_rotation = chosen.base_position, chosen.base_rotation
        self.w_m, self.w_b = chosen.w_m, chosen.w_b
        self.branch, self.pose_number = chosen.branch, chosen.pose_number
        self._keys = self.points[:, 0] * len(grasp_map) + self.points[:, 1]
        stances = self.checks.stances(self.points, chosen)
        if known.releases is not None:
            stances = stances._replace(releases=known.releases)
        self._free = self._known = TwoLimbEdges(self.checks, stances, len(grasp_map), known.edges)
        self._table: NodeTable | None = None
        self._is_table_complete = False

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy what the graph is made of, and what no file has of its stances and steps."""
        kind, made_of, world = super().__reduce__()
        return kind, (*made_of, None if self._is_from_file else self.file_contents()), world

    @property
    @locked
    def table(self) -> NodeTable:  # type: ignore[override]
        """All stances and the edges checked so far; once all are, a new and complete table."""
        if self._table is None or (self._free.is_complete and not self._is_table_complete):
            self._table = two_limb_nodes(self._free.table, self.pose_number)
            self._is_table_complete = self._free.is_complete
        return self._table

    @property
    def is_table_complete(self) -> bool:
        """Whether the table has every step, among the present obstacles too."""
        return self._is_table_complete and not (self.obstacles and self.settings.transitions)

    def _computed(self) -> TwoLimbStances:
        """Compute every stance, without steps."""
        postures = self.postures(self.pairs)
        node = self.is_node(postures)
        clear, w_b = postures.cause == CLEAR, postures.w_b
        stuck = ~node & clear & (w_b > 0.0) & (w_b >= self.base_threshold)
        no_departure = (stuck & (postures.w_m >= self.limb_threshold).all(axis=1)).sum()
        counts = [len(self.pairs), int(postures.reachable.sum()), int(no_departure)]
        counts += [int(np.isin(postures.cause[~node], causes).sum()) for causes in REMOVED.values()]
        points = np.ascontiguousarray(self.pairs[node])
        return TwoLimbStances(points, postures.take(node), dict(zip(COUNTS, counts, strict=True)))

    def file_contents(self) -> TwoLimbStances:
        """Return all that is known without obstacles and occupied points, as files have it."""
        table, known = self._free.table, self._contents
        is_all = self._free.is_complete and table.check
        return known._replace(releases=table.releases, edges=table.edges) if is_all else known

    @property
    @locked
    def branch_sets(self) -> IntArray:
        """Branches and flips on which each limb may hold among the obstacles, shape (n, 2)."""
        self._known.check_nodes(slice(None))
        return self._known.table.branch_sets

    @property
    def is_complete(self) -> bool:
        """Whether every step is known, among the present obstacles and occupied points."""
        return self._known.is_complete

    @is_complete.setter
    def is_complete(self, is_complete: bool) -> None:
        self._known.is_complete = is_complete

    @property
    def is_complete_without_obstacles(self) -> bool:
        """Whether every step is known, without obstacles and occupied points."""
        return self._free.is_complete

    @property
    def steps(self) -> TwoLimbTable:
        """The edges checked so far, among the present obstacles, as compiled code reads them.

        Of stances that no edge or release was checked for, branches may still touch obstacles.
        """
        return self._known.table

    @property
    def blocked_edges(self) -> IntArray:
        """Numbers of edges of the table that are known to be no steps at present, shape (k,)."""
        return self._known.blocked

    def check_steps(self, support: IntArray, before: IntArray, after: IntArray) -> None:
        """Check steps once, given by support limb, stance before and stance after, (k,) each."""
        self._known.check_steps(support, before, after)

    def check_releases(self, todo: IntArray) -> None:
        """Compute releases once, given by stances and limbs, shape (k, 2)."""
        self._known.check_releases(todo)

    def stances_with(self, limb: int, point: int) -> IntArray:
        """Return the row of a point: all stances in which a limb holds it, shape (k,)."""
        table = self.steps
        return table.rows[limb, table.row_start[limb, point] : table.row_start[limb, point + 1]]

    def edges_of_row(self, support: int, point: int) -> IntArray:
        """Return every pair of stances of a row, the lower index last, shape (2, k)."""
        row = self.stances_with(support, point)
        i, j = np.tril_indices(len(row), -1)
        return np.stack([row[i], row[j]])

    def _obstacles_changed(self, added: tuple[Box, ...] | None) -> None:
        """Start from the stances as they were before obstacles were added, or without obstacles."""
        if added is None:
            added, self._known = self.obstacles, self._free
        if not (self.obstacles or self.occupied):
            return
        # A step may touch an obstacle that is farther from both ends than the robot reaches.
        around = self.robot.extent + self.settings.clearance
        reach = around + 0.8 * self.max_displacement
        is_all = len(added) == len(self.obstacles)
        new = (is_all and self.obstacle_grid) or box_grid(added, OBSTACLE_CELL_EDGE)
        close = self.close_to_obstacles(self._cells, reach, new)
        closest = self.close_to_obstacles(self._cells, around, new)
        forbidden = self.solver.causes_at_points(new) > 0
        forbidden[list(self.occupied)] = True
        gone = np.asarray(forbidden[self.points].any(axis=1))
        self._known = TwoLimbEdgesAmongObstacles(
            self._known, gone, closest, close, self.obstacle_grid, new
        )
        if not self.settings.transitions:
            self._known.check_nodes(slice(None))

    @cached_property
    def _cells(self) -> PositionCells:
        """The base positions by cells."""
        return PositionCells.of(self.base_position)

    @property
    def releasable(self) -> IntArray:
        """Branches on which limbs can be released, for the releases known so far, shape (n, 2).

        If steps are not checked, they are all on which limbs may hold.
        """
        table = self.steps
        return np.asarray(table.releases["branches"] if table.check else table.branch_sets)

    def __len__(self) -> int:
        """Return the number of stances."""
        return len(self.points)

    def find(self, stance: Sequence[int]) -> int:
        """Return the index of a stance given by point indices, -1 if it is no node."""
        self.check_stance(stance)
        key = stance[0] * len(self.grasp_map) + stance[1]
        k = int(self._keys.searchsorted(key))
        return k if k < len(self._keys) and self._keys[k] == key else -1

    def posture(self, stance: Sequence[int]) -> Postures:
        """Return the posture of a stance given by point indices; arrays have a leading 1."""
        s = self.find(stance)
        return super().posture(stance) if s < 0 else self.node_postures(slice(s, s + 1))

    @checked({"states": STATES})
    def postures_of(self, states: Sequence[State]) -> Postures:
        """Return the postures of k states."""
        rows = np.array([self.find(state.stance) if state.pose is None else -1 for state in states])
        return self.node_postures(rows) if (rows >= 0).all() else super().postures_of(states)

    def node_postures(self, chosen: slice | IntArray) -> Postures:
        """Return the postures of stances given by index."""
        self._known.check_nodes(chosen)
        found = self._contents.postures.take(chosen)
        return replace(found, branch_sets=self.steps.branch_sets[chosen])

    def _fault(
        self, points: tuple[int, ...], posture: Postures, pose: tuple[float, ...] | None = None
    ) -> str:
        node = pose is None and self.find(points) >= 0
        if node and not self.occupied.intersection(points):
            return f"its posture touches {TOUCHED[OBSTACLE]}"
        return super()._fault(points, posture, pose)

    def _node(self, stance: Sequence[int], position: Array, rotation: Array) -> int:
        """Return the index of a stance with its own posture, -1 if the base is elsewhere."""
        s = self.find((int(stance[0]), int(stance[1])))
        same = (
            s >= 0
            and (position == self.base_position[s]).all()
            and (rotation == self.base_rotation[s]).all()
        )
        return s if same else -1

    def releasable_branches(self, stance: tuple[int, ...], posture: Postures, limb: int) -> int:
        """Return the branches on which a limb can be released; see `CheckedSteps`."""
        s = self._node(stance, posture.base_position[0], posture.base_rotation[0])
        if s < 0:
            return super().releasable_branches(stance, posture, limb)
        return self._releasable_now(s, limb)

    @checked(late=True)
    def states_along(self, state: State, stances: Sequence[tuple[int, ...]]) -> tuple[State, ...]:
        """Return a state and those after steps from it, see `StanceGraph.states_along`."""
        self.check(state)
        states = [state]
        for stance in stances:
            self.check_stance(stance)
            if (after := self._state_after_step(states[-1], stance)) is None:
                break
            states.append(after)
        return tuple(states)

    def _state_after_step(self, state: State, after: tuple[int, ...]) -> State | None:
        """Return the state after the step to a stance, None without such a step."""
        if (np.array(state.stance) != after).sum() != 1:
            return None
        limb, rows = moving_limb(state.stance, after), [NO_STEPS[:, 0]] * 2
        rows[limb] = np.array([s for s in (self.find(after),) if s >= 0], dtype=np.int64)
        steps = self._steps_to(state, rows) if state.pose is None else self.successors(state)
        k = steps.find(limb, after[limb])
        return None if k < 0 else steps.after(state, k)

    @checked(late=True)
    def releasable_after(self, state: State, steps: Successors) -> BoolArray:
        """Return whether the support limb could be released after each step, shape (k,)."""
        self.check(state)
        states = [steps.after(state, k) for k in range(len(steps.limb))]
        supports = zip(states, (1 - steps.limb).tolist(), strict=True)
        grasped = self.branch_set_after_grasp
        able = [can_release(s.branch_sets[i], grasped(s, i)) for s, i in supports]
        return np.array(able, dtype=np.bool_)

    def row(self, support: int, s: int) -> IntArray:
        """Return the other stances in which limb `support` holds the same point as at `s`."""
        row = self.stances_with(support, self.points[s, support])
        return np.asarray(row[row != s])

    def neighbouring_nodes(
        self, stance: tuple[int, ...], pieces: Pieces = at_once
    ) -> tuple[IntArray, Postures]:
        """Return the neighbouring nodes of a stance, see `StanceGraph.neighbouring_nodes`."""
        self.check_stance(stance)
        chosen = np.concatenate([self.stances_with(1 - i, stance[1 - i]) for i in range(2)])
        chosen = chosen[(self.points[chosen] != stance).any(axis=1)]
        found = [self.node_postures(chosen[piece]) for piece in pieces("postures", len(chosen))]
        postures = join(self.node_postures(chosen[:0]), *found)
        node = self.is_node(postures)
        return self.points[chosen[node]], postures.take(node)

    def kept_branches(self, support: Any, before: Any, after: IntArray) -> IntArray:
        """Return the branches that support limbs keep on steps, which are checked once, shape (k,).

        The support limb and the stance before are one for all steps or one for each, shape (k,);
        the stances after them have shape (k,).
        """
        if not self.settings.transitions:
            return np.full(len(after), ALL, dtype=np.int64)
        if not self.is_complete:
            self.check_steps(*map(np.array, np.broadcast_arrays(support, before, after)))
        index = self._known.index(support, before, after)
        return np.asarray(self.steps.edges["kept"][index], dtype=np.int64)

    def kept_at_most(self, support: IntArray, before: IntArray, after: IntArray) -> IntArray:
        """Return an upper bound of `kept_branches` that is quick to see, for arrays, shape (k,)."""
        known = self._known.look if self.settings.transitions else self.kept_branches
        return known(support, before, after)

    def successors(self, state: State) -> Successors:
        """Return all steps that leave a state."""
        self.check(state)
        if state.pose is not None:
            return super().successors(state)
        s = self.find(state.stance)
        return self._steps_to(state, [self.row(1 - limb, s) for limb in range(2)])

    def _steps_to(self, state: State, rows: Sequence[IntArray]) -> Successors:
        """Return the steps that move each limb from a state to some stances of its row."""
        s, found = self.find(state.stance), [NO_STEPS]
        branch_sets, grasps = self.steps.branch_sets, self.releasable
        for limb, row in enumerate(rows if s >= 0 else ()):
            support = 1 - limb
            if len(row) and can_release(state.branch_sets[limb], self._releasable_now(s, limb)):
                self._known.check_nodes(row)
                shared = branch_sets[row, support] & state.branch_sets[support]
                row, shared = row[shared != 0], shared[shared != 0]
                kept = shared & self.kept_branches(support, s, row)
                steps = np.stack([np.full(len(row), limb), row, kept, grasps[row, limb]], axis=1)
                found.append(steps[steps[:, 2:].all(axis=1)])
        limb, stance, kept, grasped = np.concatenate(found).T
        both = np.stack([np.where(limb, kept, grasped), np.where(limb, grasped, kept)], axis=1)
        return Successors(limb, self.points[stance, limb], self.base_position[stance], both)

    def _check_releases(self, stances: StanceArrays, todo: IntArray) -> None:
        """Compute releases, see `CheckedSteps`; those of the graph's stances are stored there."""
        for row in np.unique(todo[:, 0]).tolist():
            base = stances.base[row]
            s = self._node(stances.points[row], base["position"], base["rotation"])
            if s >= 0:
                limbs = todo[todo[:, 0] == row, 1]
                self._known.check_releases(np.stack([np.full_like(limbs, s), limbs], axis=1))
                stances.releases[row, limbs] = self.steps.releases[s, limbs]
        super()._check_releases(stances, todo)

    def _releasable_now(self, s: int, limb: int) -> int:
        """Return the branches on which a limb of a stance can be released, checked once."""
        if not self.settings.transitions:
            return ALL
        if not self.steps.releases["known"][s, limb]:
            self._known.check_releases(np.array([[s, limb]]))
        return int(self.releasable[s, limb])

    @cached_property
    def max_displacement(self) -> float:
        """Largest base displacement of one step [m], over all pairs of stances of a row."""
        out, table = np.zeros(len(self.grasp_map)), self._free.table
        for support in range(2):
            longest_step(support, table.rows, table.row_start, self.base_position, out)
        return max(float(np.sqrt(out.max())), 1e-9)
