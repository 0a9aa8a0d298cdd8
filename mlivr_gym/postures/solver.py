"""Postures of stances on a map: the base pose, and the branches on which limbs may hold."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid, box_grid
from mlivr_gym.collisions.distances import CLEAR
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.queries import (
    CheckedPostures,
    QueryScratch,
    Surroundings,
    check_points,
    remove_touching_branches,
)
from mlivr_gym.compiled.bit_sets import BRANCHES
from mlivr_gym.compiled.kernels import in_parallel
from mlivr_gym.compiled.scratch import ScratchPool
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.kinematics.poses import Pose, poses
from mlivr_gym.postures.base_poses import (
    TIE,
    bases_at,
    candidates_of,
    pose_rules,
    set_bases,
    set_codes,
)
from mlivr_gym.postures.postures import FIELDS, Postures
from mlivr_gym.postures.reach import orders_of, sets_in_reach
from mlivr_gym.postures.records import (
    MapPoints,
    Posture,
    PostureScratch,
    PostureWorld,
    StanceGeometry,
    Thresholds,
)
from mlivr_gym.postures.relabelling import relabelled
from mlivr_gym.postures.selection import solve_all
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.world.grasp_map import GraspMap

SCRATCH = ScratchPool(PostureScratch)
"""Scratch of the choice of postures."""

COMBINATIONS_IN_THREADS = 128_000
"""Number of combinations of branches, of all stances, from which on threads compute postures."""

TOUCHING_IN_THREADS = 100
"""Minimum number of postures that are compared with boxes in threads; each takes about 5 us."""


class PostureSolver:
    """Postures of stances on a map, see `rule`.

    `shapes.rows`, `grasps` (m,), `boxes` and `thresholds` (1,) are robot, points, boxes and
    thresholds as compiled code reads them.
    """

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Prepare map, robot and thresholds as compiled code reads them."""
        self.grasp_map, self.robot, self.settings = grasp_map, robot, settings
        self.shapes = LimbShapes(robot)
        rails = grasp_map.rotations[:, :, 0]
        self.grasps = grasp_rows(grasp_map.positions, grasp_map.normals, rails, robot.tool_length)
        self.boxes, self._no_boxes = box_grid(grasp_map.boxes), box_grid(())
        self.thresholds = self._thresholds(settings.thresholds(robot.limbs))

    @cached_property
    def point_cause(self) -> IntArray:
        """Cause of the collision of a gripper at each point, 0 for none, shape (m,)."""
        if not self.settings.collisions:
            return np.zeros(len(self.grasp_map), dtype=np.int64)
        return self.causes_at_points(self.boxes)

    def _thresholds(self, least: tuple[float, float]) -> Any:
        """Return the thresholds of stances and steps as a record of `Thresholds`, shape (1,).

        `least` holds the minimum `w_m` and `w_b`.
        """
        out = Thresholds.rows(1)
        out["w_m"], out["w_b"] = least
        out["floor"], out["clearance"] = self.settings.path_floor, self.settings.clearance
        return out

    def surroundings(self, grid: BoxGrid) -> Surroundings:
        """Return the points of the map together with given boxes."""
        return Surroundings(self.grasps, grid, self.settings.clearance)

    def causes_at_points(self, grid: BoxGrid) -> IntArray:
        """Return the cause of the collision of a gripper at each point, 0 for none, shape (m,)."""
        out = np.zeros((len(self.shapes.by_limb), len(self.grasp_map)), dtype=np.int64)
        for rows, causes in zip(self.shapes.by_limb, out, strict=True):
            check_points(rows, self.surroundings(grid), QueryScratch.rows(1), causes)
        return np.array(out.max(axis=0), dtype=np.int64)

    def remove_touching(self, chosen: IntArray, postures: CheckedPostures, grid: BoxGrid) -> None:
        """Remove the branches that touch a box from the branch sets of postures given by index."""
        world, rows = self.surroundings(grid), QueryScratch.rows
        in_parallel(
            len(chosen), remove_touching_branches, chosen, postures, self.shapes.rows, world,
            scratch_rows=rows, least=TOUCHING_IN_THREADS,
        )  # fmt: skip

    def solve(self, stances: IntArray, *, nodes_only: bool = False) -> Postures:
        """Compute the postures of stances given by point indices, shape (k, N).

        With `nodes_only` a stance that cannot be held has zero branch sets and no other result;
        this is much faster.
        """
        thresholds = self.settings.thresholds(self.robot.limbs)
        rules = self._rules(thresholds, self.settings.collisions, nodes_only=nodes_only)
        postures = self._solve(stances, rules)
        if self.settings.collisions:
            self._avoid_boxes(stances, postures, rules)
        return postures

    def at(
        self,
        stances: IntArray,
        positions: Array,
        rotations: Array,
        *,
        thresholds: tuple[float, float] = (0.0, 0.0),
        collisions: bool | None = None,
    ) -> Postures:
        """Compute the branches of stances (k, N) at given base poses in the world.

        Positions have shape (k, 3) [m], rotations (k, 3, 3). Thresholds are those of `w_m` and
        `w_b`; the floor of `w_m` on departures applies whatever they are. `collisions` is whether
        to exclude branches that touch something, by default as in the settings.
        """
        collisions = self.settings.collisions if collisions is None else collisions
        rules = self._rules(thresholds, collisions)
        rules["is_given"], rules["among_boxes"] = True, collisions
        postures = self._solve(stances, rules, poses(positions, rotations))
        if collisions:
            postures.branch_sets[self.point_cause[stances].max(axis=1) != CLEAR] = 0
        return postures

    def candidate_poses(self, stance: Sequence[int]) -> tuple[Array, Array]:
        """Return the candidate base poses of a stance given by point indices, in the world.

        These are positions [m], shape (k, 3), and rotations, shape (k, 3, 3), in the order of their
        numbers.
        """
        most = max(len(heights) * len(rolls) for heights, rolls in candidates_of(self.robot))
        numbers = np.arange(most)
        stances = np.tile(np.array(stance, dtype=np.int64), (len(numbers), 1))
        positions, rotations = bases_at(self.grasp_map, self.robot, stances, numbers)
        there = ~np.isnan(positions[:, 0])
        return positions[there], rotations[there]

    def in_reach(
        self, sets: IntArray, target: Array | None = None, tolerance: float = np.inf
    ) -> BoolArray:
        """Return which sets of points (k, N) meet the condition of every node; see `reach`.

        A base position `target` (3,) [m] may be requested, from which the base is at most
        `tolerance` away [m].
        """
        region = np.append(np.zeros(3) if target is None else target, tolerance)
        rules = self._rules(self.settings.thresholds(self.robot.limbs), False)
        out, world = np.zeros(len(sets), dtype=np.bool_), self._world(rules)
        asked = np.ascontiguousarray(sets), orders_of(self.robot), world, region, out
        with SCRATCH.borrowed() as rows:
            in_parallel(len(sets), sets_in_reach, *asked, scratch_rows=rows)
        return out

    def _rules(
        self, thresholds: tuple[float, float], collisions: bool, *, nodes_only: bool = False
    ) -> Any:
        """Return the rule of postures as a record of `PostureRule`, shape (1,)."""
        rules, limbs = pose_rules(self.robot), self.robot.limbs
        given, default = self.settings.thresholds(limbs), Settings().thresholds(limbs)
        scales = given[0] or default[0], given[1] or default[1]
        margin = min(a / b for a, b in zip(thresholds, scales, strict=True))
        rules["thresholds"] = self._thresholds(thresholds)
        rules["scale_m"], rules["scale_b"] = scales
        rules["node_margin"], rules["nodes_only"] = margin * (1.0 - 3.0 * TIE), nodes_only
        rules["check_branches"] = self.settings.transitions
        if not collisions:
            rules["thresholds"]["clearance"] = 0.0
        return rules

    def _world(self, rules: Any) -> PostureWorld:
        """Return what all stances share, with a rule."""
        points = MapPoints(self.grasp_map.positions, self.grasp_map.rotations)
        return PostureWorld(self.shapes.rows, rules, points, self.boxes)

    def _codes(self, stances: IntArray, rules: Any) -> tuple[IntArray, IntArray]:
        """Return codes of the relative geometries of stances, and their first limbs, (k,)."""
        stances, points = np.ascontiguousarray(stances), self._world(rules).points
        codes, first = (np.empty(len(stances), dtype=np.int64) for _ in range(2))
        set_codes(stances, points, rules, StanceGeometry.rows(1), codes, first)
        return codes, first

    def _solve(self, stances: IntArray, rules: Any, given: Any = None) -> Postures:
        """Compute the postures of stances by a rule, at base poses if the rule has them given.

        Those of the robot alone are computed once for all stances of the same relative geometry.
        """
        stances, world, limbs = np.ascontiguousarray(stances), self._world(rules), self.robot.limbs
        count, is_given = len(stances), given is not None
        codes, first = self._codes(stances, rules)
        if rules["is_given"] or rules["among_boxes"]:
            codes = np.arange(count)
        _, one, same = np.unique(codes, return_index=True, return_inverse=True)
        postures = Posture.rows(len(one))
        bases = given if is_given else Pose.rows(1)
        least = COMBINATIONS_IN_THREADS // BRANCHES**limbs
        with SCRATCH.borrowed() as rows:
            in_parallel(
                len(one), solve_all, stances[one], bases, world, postures, scratch_rows=rows,
                least=least,
            )  # fmt: skip
        postures = postures[same]
        number = np.full(count, -1) if is_given else postures["pose_number"].copy()
        if not is_given:
            bases = Pose.rows(count)
            set_bases(stances, number, world.points, rules, StanceGeometry.rows(1), bases)
            bases[number < 0] = np.zeros((), Pose.dtype)
        w_m, branch, branch_sets = (
            relabelled(postures[name][:, :limbs], -first % limbs)
            for name in ("w_m", "branch", "branch_sets")
        )
        return Postures(
            bases["position"].copy(), bases["rotation"].copy(), w_m, postures["w_b"].copy(), branch,
            branch_sets, number, postures["cause"].copy(),
        )  # fmt: skip

    def _avoid_boxes(self, stances: IntArray, postures: Postures, rules: Any) -> None:
        """Remove branches that touch a box; where a posture does, choose one that does not."""
        held = np.flatnonzero(postures.branch_sets.all(axis=1))
        postures.cause[held] = self.point_cause[stances[held]].max(axis=1)
        rows = held[postures.cause[held] == CLEAR]
        _, first = self._codes(stances, rules)
        checked = postures.checked(stances, self.settings.transitions, first)
        self.remove_touching(rows, checked, self.boxes)
        rows = rows[postures.cause[rows] != CLEAR]
        rules["among_boxes"] = rules["nodes_only"] = True
        others = self._solve(stances[rows], rules)
        free = others.branch_sets.all(axis=1)
        for name in FIELDS:
            getattr(postures, name)[rows[free]] = getattr(others, name)[free]
        postures.branch_sets[held[postures.cause[held] != CLEAR]] = 0
