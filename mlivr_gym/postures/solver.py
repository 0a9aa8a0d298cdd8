"""Computation of postures: the base pose of a stance, and the branches on which limbs may hold.

The body's z axis lies along the mean outward normal of the held points; with two limbs, along its
part perpendicular to the line through the grasps. The yaw (and, for N > 2, the sense of z) follows
from the Procrustes fit of the mounts' azimuths to the grasps. The origin is the centroid of the
grasps plus a height along that direction. The candidates are heights, rolls about the line through
the grasps, and the branches of each limb. Between opposite walls the mean normal vanishes; there
the rolls about that line span a full turn, starting from the rail of the first grasp.

**The rule.** Candidates in which the robot penetrates itself are excluded. Of the others, the one
with the largest margin is chosen: the minimum of `w_m / limb_threshold` over the limbs and of `w_b
/ base_threshold`. Margins within `TIE` count as equal, as those of mirror postures are: then the
largest clearance of the robot from itself decides, and if that is equal within `CLEARANCE_TIE`, a
fixed order in the frame of the grasps. It prefers the smaller roll, of two opposite rolls the
positive one about the line from the centroid to the grasp of the first limb, then the lower base,
then the lower branch numbers from the last limb to the first. The first limb of two is limb 0: the
line reverses when they are exchanged, so no side of the module is favoured. Of more limbs it is the
one with the grasp closest to the centroid, see `relabelling`. Only between opposite walls does the
sign of the rail direction matter. With collisions checked, it applies to what touches nothing.

Except for the surroundings, the result depends only on the relative geometry of the grasps. It is
computed in the frame of the first grasp from rounded coordinates, see `geometries`, once for each
geometry. Where that posture touches the surroundings, the candidates are evaluated again in place,
of many stances once for those that have the same boxes around them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid, box_grid
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.queries import (
    CheckedPostures,
    QueryScratch,
    Surroundings,
    check_points,
    remove_touching_branches,
)
from mlivr_gym.compiled.kernels import in_parallel
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.postures.alike_points import classes_of_points
from mlivr_gym.postures.candidate_poses import (
    Candidates,
    bases_of_ordered,
    geometries_in_world,
    rounded_geometries_in_world,
)
from mlivr_gym.postures.geometries import (
    RelativeGeometries,
    geometries_of_rows,
    in_world,
    relative_geometries,
)
from mlivr_gym.postures.in_reach import ReachScratch, orders_of, reach_queries, sets_in_reach
from mlivr_gym.postures.postures import FIELDS, Postures, PostureTable
from mlivr_gym.postures.records import (
    Posture,
    PostureRule,
    PostureScratch,
    StanceGeometry,
    Thresholds,
)
from mlivr_gym.postures.relabelling import first_limbs, relabelled, relabelled_frames
from mlivr_gym.postures.rule import TIE
from mlivr_gym.postures.selection import solve_postures
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.world.grasp_map import GraspMap

LEAST_ALIKE = 10_000
"""Minimum number of stances of which those that are alike are treated once."""

LEAST_IN_THREADS, MANY_LIMBS_IN_THREADS = 2000, 32
"""Minimum number of stances of two, and of more limbs that are computed in threads."""

TOUCHING_IN_THREADS = 100
"""Minimum number of postures that are compared with boxes in threads; each takes about 5 us."""


class PostureSolver:
    """Postures of stances on a map, computed once for each relative geometry.

    `shapes.rows`, `grasps` (m,), `boxes` and `thresholds` (1,) are robot, points, boxes and
    thresholds as compiled code reads them. `point_cause` (m,) is the cause of the collision of a
    gripper at each point, 0 for none; see `distances`.
    """

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Prepare map, robot and thresholds as compiled code reads them."""
        self.grasp_map, self.robot, self.settings = grasp_map, robot, settings
        self.shapes = LimbShapes(robot)
        rails = grasp_map.rotations[:, :, 0]
        self.grasps = grasp_rows(grasp_map.positions, grasp_map.normals, rails, robot.tool_length)
        self.boxes, self._no_boxes = box_grid(grasp_map.boxes), box_grid(())
        self.thresholds = self._thresholds(settings.thresholds(robot.limbs))
        self.point_cause = np.zeros(len(grasp_map), dtype=np.int64)
        if settings.collisions:
            self.point_cause = self.causes_at_points(self.boxes)
        self._index_of: dict[bytes, int] = {}
        self._rejected: set[int] = set()
        """Indices of geometries that are known to be no nodes, without further results."""
        self._solved = PostureTable(robot.limbs)

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

    @property
    def geometries(self) -> int:
        """Number of relative geometries solved so far."""
        return len(self._index_of)

    def solve(self, stances: IntArray, *, nodes_only: bool = False) -> Postures:
        """Compute the postures of stances given by point indices, shape (k, N).

        With `nodes_only` a stance that cannot be held has zero branch sets and no other result;
        this is much faster.
        """
        if self.robot.limbs == 2 or not self.robot.is_symmetric:
            return self._solve(stances, nodes_only)
        relabellings = first_limbs(self.grasp_map, stances)
        return self._solve(relabelled(stances, relabellings), nodes_only).relabelled(-relabellings)

    def _solve(self, stances: IntArray, nodes_only: bool) -> Postures:
        """Compute postures of stances whose limb 0 is the first limb of the rule; see `solve`."""
        rows, inverse = relative_geometries(self.grasp_map, stances)
        new: list[int] = []
        where = np.empty(len(rows), dtype=np.int64)
        for r, row in enumerate(rows):
            key = row.tobytes()
            found = self._index_of.get(key)
            if found is None or (not nodes_only and found in self._rejected):
                found = self._index_of[key] = self._solved.used + len(new)
                new.append(r)
            where[r] = found
        if new:
            self._solve_new(rows[np.array(new)], nodes_only)
        local = self._solved.take(where[inverse])
        first = np.ascontiguousarray(stances[:, 0])
        bases = in_world(self.grasp_map, first, local.base_position, local.base_rotation)
        postures = replace(local, base_position=bases[0], base_rotation=bases[1])
        if self.settings.collisions:
            self._avoid_boxes(stances, where[inverse], postures)
        return postures

    def _avoid_boxes(self, stances: IntArray, geometries: IntArray, postures: Postures) -> None:
        """Remove branches that touch a box; choose another posture if its own branches do.

        Stances with the same of `geometries`, shape (k,), and the same boxes around their first
        point are treated once.
        """
        nodes = np.flatnonzero(np.all(postures.branch_sets > 0, axis=1))
        touching = self.point_cause[stances[nodes]].max(axis=1)
        postures.cause[nodes] = touching
        postures.branch_sets[nodes[touching > 0]] = 0
        nodes = nodes[touching == 0]
        ones, one_of = nodes, np.arange(len(nodes))
        if len(nodes) >= LEAST_ALIKE:
            alike = self._classes_of_points[stances[nodes, 0]] * self._solved.used
            _, first, one_of = np.unique(
                alike + geometries[nodes], return_index=True, return_inverse=True
            )
            ones = nodes[first]
        checked = postures.checked(stances, self.settings.transitions)
        self.remove_touching(ones, checked, self.boxes)
        touches = postures.cause[ones] > 0
        self._choose_again(stances, ones[touches], postures)
        if len(ones) == len(nodes):
            return
        for name in FIELDS[2:]:
            values = getattr(postures, name)
            values[nodes] = values[ones[one_of]]
        again = nodes[touches[one_of]]
        again = again[np.all(postures.branch_sets[again] > 0, axis=1)]
        bases = bases_of_ordered(
            self.grasp_map, self.robot, stances[again], postures.pose_number[again]
        )
        postures.base_position[again], postures.base_rotation[again] = bases

    @cached_property
    def _classes_of_points(self) -> IntArray:
        """Classes of points with the same boxes within reach of a robot that holds one of them."""
        reach = 2.0 * self.robot.extent + self.settings.clearance
        return classes_of_points(self.grasp_map, reach)

    def _choose_again(self, stances: IntArray, again: IntArray, postures: Postures) -> None:
        """Choose other postures, which touch no box, for some stances, given by index."""
        if not len(again):
            return
        geometry = rounded_geometries_in_world(self.grasp_map, stances[again])
        new = self._solve_in_place(geometry, self.boxes, avoid=True)
        better = np.all(new.branch_sets > 0, axis=1)
        postures.branch_sets[again] = 0
        again, new = again[better], new.take(better)
        # Equal up to rounding; this way a base pose has the same digits wherever it is computed.
        bases = bases_of_ordered(self.grasp_map, self.robot, stances[again], new.pose_number)
        new = replace(new, base_position=bases[0], base_rotation=bases[1])
        for name in FIELDS:
            getattr(postures, name)[again] = getattr(new, name)

    def _solve_new(self, rows: IntArray, nodes_only: bool) -> None:
        """Compute and store the postures of relative geometries."""
        grasps, centroid = geometries_of_rows(rows, self.robot.limbs)
        out = self._solve_in_place(grasps, self._no_boxes, avoid=False, nodes_only=nodes_only)
        out.base_position[:] += centroid
        if nodes_only:
            rejected = np.flatnonzero(~np.all(out.branch_sets > 0, axis=1)) + self._solved.used
            self._rejected.update(rejected.tolist())
        self._solved.append(out)

    @cached_property
    def _scales(self) -> tuple[float, float]:
        """Limb and base manipulability at margin 1."""
        given = self.settings.thresholds(self.robot.limbs)
        default = Settings().thresholds(self.robot.limbs)
        return given[0] or default[0], given[1] or default[1]

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
        count = len(stances)
        geometry = geometries_in_world(self.grasp_map, stances)
        away = positions - geometry.centres
        frames = (rotations.copy(), away, away, np.zeros(count, dtype=np.bool_))
        # One candidate: height 1 along the vector from the centroid to the base, roll 0.
        one, zero = np.ones(1), np.zeros(1)
        out = self._run(
            geometry,
            Candidates(frames, one, zero, one, zero),
            self.boxes if collisions else self._no_boxes,
            thresholds=thresholds,
            avoid=collisions,
            collisions=collisions,
        )
        out.base_position[:], out.base_rotation[:], out.pose_number[:] = positions, rotations, -1
        if collisions:
            out.branch_sets[self.point_cause[stances].any(axis=1)] = 0
        return out

    def candidate_poses(self, stance: Sequence[int]) -> tuple[Array, Array]:
        """Return the candidate base poses of a stance given by point indices, in the world.

        These are positions [m], shape (k, 3), and rotations, shape (k, 3, 3), in the order of their
        numbers.
        """
        points = np.array([stance], dtype=np.int64)
        relabellings = first_limbs(self.grasp_map, points, self.robot.is_symmetric)
        geometry = geometries_in_world(self.grasp_map, relabelled(points, relabellings))
        frames, heights, rolls, *between_walls = Candidates.of(self.robot, geometry)
        frame, out, line, opposed = (part[0] for part in frames)
        if opposed:
            heights, rolls = between_walls
        rolled = scipy.spatial.transform.Rotation.from_rotvec(rolls[:, None] * line).as_matrix()
        positions = geometry.centres[0] + heights[:, None] * (rolled @ out)[:, None]
        rotations = np.repeat(rolled @ frame, len(heights), axis=0)
        frames_of = relabelled_frames(rotations, -relabellings, len(stance))
        return positions.reshape(-1, 3), frames_of

    def in_reach(
        self, sets: IntArray, target: Array | None = None, tolerance: float = np.inf
    ) -> BoolArray:
        """Return which sets of points (k, N) meet the condition of every node; see `in_reach`.

        A base position `target` (3,) [m] may be requested, from which the base is at most
        `tolerance` away [m].
        """
        robot = self.robot
        candidates = Candidates.of(robot, geometries_in_world(self.grasp_map, sets[:1]))
        w_m = self.settings.thresholds(robot.limbs)[0]
        queries = reach_queries(robot, w_m, candidates[1:], target, tolerance)
        out = np.zeros(len(sets), dtype=np.bool_)
        world = self.shapes.rows, self.grasps, queries, orders_of(robot)
        in_parallel(len(sets), sets_in_reach, sets, world, out, scratch_rows=ReachScratch.rows)
        return out

    def _solve_in_place(
        self, geometry: RelativeGeometries, grid: BoxGrid, *, avoid: bool, nodes_only: bool = False
    ) -> Postures:
        """Compute postures among the robot's candidates, relative to the centroids of the grasps.

        With `avoid` the posture of the largest margin is known to touch something.
        """
        return self._run(
            geometry,
            Candidates.of(self.robot, geometry),
            grid,
            thresholds=self.settings.thresholds(self.robot.limbs),
            avoid=avoid,
            collisions=self.settings.collisions,
            nodes_only=nodes_only,
        )

    def _run(
        self,
        geometry: RelativeGeometries,
        candidates: Candidates,
        grid: BoxGrid,
        *,
        thresholds: tuple[float, float],
        avoid: bool,
        collisions: bool,
        nodes_only: bool = False,
    ) -> Postures:
        """Choose the posture of each stance among given candidates."""
        settings, k = self.settings, len(geometry.positions)
        rules, count = PostureRule.rows(1), geometry.positions.shape[1]
        rule = rules[0]
        stances = StanceGeometry.rows(k)
        stances["centre"] = geometry.centres
        grasps = grasp_rows(
            geometry.positions, geometry.normals, geometry.rails, self.robot.tool_length
        )
        stances["grasps"][:, :count] = grasps
        candidates.write(stances, rules)
        rule["thresholds"] = self._thresholds(thresholds)[0]
        rule["scale_m"], rule["scale_b"] = self._scales
        margin = min(a / b for a, b in zip(thresholds, self._scales, strict=True))
        rule["node_margin"], rule["best_touches"] = margin * (1.0 - 3.0 * TIE), avoid
        rule["check_branches"], rule["check_contacts"] = settings.transitions, collisions
        rule["nodes_only"] = nodes_only
        out = Posture.rows(k)
        robots, least = self.shapes.rows, LEAST_IN_THREADS if count == 2 else MANY_LIMBS_IN_THREADS
        in_parallel(
            k, solve_postures, stances, robots, rules, grid, out,
            scratch_rows=PostureScratch.rows, least=least,
        )  # fmt: skip
        return Postures(
            out["base"]["position"].copy(),
            out["base"]["rotation"].copy(),
            out["w_m"][:, :count].copy(),
            out["w_b"].copy(),
            out["branch"][:, :count].copy(),
            out["branch_sets"][:, :count].copy(),
            out["pose_number"].copy(),
            out["cause"].copy(),
        )
