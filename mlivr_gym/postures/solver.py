"""Postures: the base pose that belongs to a stance.

Body z lies along the mean outward normal of the held points, for two limbs along its part across
the line through the grasps; yaw (and, for N > 2, the sense of z) follows from the Procrustes fit
of the mounts' azimuths to the grasps; the origin is the grasps' centroid plus a height along that
direction. Candidates are heights, rolls about the line through the grasps, and the branches of each
limb. Between opposite walls the mean normal vanishes: there the body rolls right round that
line, from the rail of the first grasp on.

**The rule.** A candidate in which the robot penetrates itself is none. Of the others the one with
the largest margin `min(w_m / w_m_min over limbs, w_b / w_b_min)` is taken. Margins within `TIE`
count as equal, as those of mirror postures are: then the largest clearance of the robot to itself
decides, and if that is equal within `CLEARANCE_TIE` too, a fixed order in the frame of the grasps:
the smaller roll, of two opposite ones the positive about the line from the centroid to the grasp of
limb 0, the lower base, the lower branch labels from the last limb to the first. That line turns
round when two limbs change places, so no side of the module is favoured; only between opposite
walls does the sign of the rail's direction enter. The order in which heights and rolls are listed
plays no part. With collisions checked the rule is the same among candidates that touch nothing, so
the posture differs only where the rule's choice comes too close to something.

But for the surroundings, the result depends on the relative geometry of the grasps alone. It is
worked out in the frame of the first grasp on rounded figures, see `geometries`, once for each
geometry; where that posture touches the surroundings, the candidates are tried once more in place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.collision_model import CollisionModel
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.queries import clear_of_world, hands_clear
from mlivr_gym.compiled.kernels import in_parallel
from mlivr_gym.postures.base_frames import base_frames
from mlivr_gym.postures.geometries import Grasps, grasps_of_geometries, relative_geometries
from mlivr_gym.postures.rule import TIE
from mlivr_gym.postures.selection import solve_geometries
from mlivr_gym.robot.specification import RobotSpec, geometric_order
from mlivr_gym.settings import Settings
from mlivr_gym.world.grasp_map import GraspMap

OPPOSED_HEIGHTS = (0.15, 0.25, 0.35, 0.45)
"""Distances of the base from the line through the grasps tried there [m]."""

OPPOSED_ROLLS = 12
"""Rolls over the full circle tried there."""


@dataclass(frozen=True)
class Postures:
    """Postures of k stances.

    Attributes:
        base_position: Base positions in the world [m], shape (k, 3).
        base_rotation: Base rotations in the world, shape (k, 3, 3).
        w_m: Limb manipulability, shape (k, N); 0 where the stance cannot be held.
        w_b: Base manipulability, shape (k,).
        branch: Branch of each limb that gives the margin, shape (k, N).
        mask: Branches and flips each limb may hold on, 16-bit masks, shape (k, N).
        cause: What the best posture touches where that alone keeps the stance from being held,
            shape (k,); one of the causes in `distances`.
    """

    base_position: Array
    base_rotation: Array
    w_m: Array
    w_b: Array
    branch: IntArray
    mask: IntArray
    cause: IntArray

    @property
    def reachable(self) -> BoolArray:
        """Whether inverse kinematics has a solution, shape (k,)."""
        reachable: BoolArray = (self.w_b > 0.0) | (self.cause > 0)
        return reachable

    def take(self, index: NDArray[np.intp] | BoolArray | slice) -> Postures:
        """Postures of the chosen stances."""
        return Postures(*(getattr(self, name)[index] for name in FIELDS))


FIELDS = tuple(field.name for field in fields(Postures))
"""Names of a posture's arrays."""


class _Candidates(NamedTuple):
    """Base poses that are tried."""

    frames: tuple[Array, Array, Array, BoolArray]
    """What `base_frames` returns."""
    heights: Array
    """Heights over the centroid [m]."""
    rolls: Array
    """Rolls [rad]."""
    opposed_heights: Array
    """Heights between opposite walls [m]."""
    opposed_rolls: Array
    """Rolls between opposite walls [rad]."""


class PostureSolver:
    """Postures of stances on a map, each relative geometry solved once.

    Attributes:
        grasp_map: The map.
        robot: The robot.
        settings: Thresholds and switches.
        mount_rotations: Limb base axes in the body frame, shape (N, 3, 3).
        mount_positions: Limb base origins in the body frame [m], shape (N, 3).
        lengths: d1, a2, a3, d4, d5, d6 [m].
        limits: Joint limits [rad], shape (6, 2).
        full_turn: Whether the limits rule out nothing.
        tools: Flange rotation in the world at each grasp, flip 0, shape (m, 3, 3).
        flanges: Flange position in the world at each grasp [m], shape (m, 3).
        points: Points of the map in the world [m], shape (m, 3).
        normals: Surface normals in the world, shape (m, 3).
        rails: Rail directions in the world, shape (m, 3).
        folds: Joints 1 to 5 of folded limbs [rad], shape (f, 5).
        shapes: The robot's shapes.
        collision_model: These shapes among the map's boxes.
        point_cause: What a hand touches that holds each point, one of the causes in `distances`, 0
            if nothing; shape (m,).
    """

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Keep the figures of map, robot and thresholds in the kernels' form."""
        self.grasp_map, self.robot, self.settings = grasp_map, robot, settings
        self.mount_rotations = robot.mount_rotations
        self.mount_positions = robot.mount_positions
        self.lengths = robot.limb.lengths
        self.limits, self.full_turn = robot.limb.limits, robot.full_turn
        self.flange_axes_in_world = tool_rotations(grasp_map)
        self.flanges_in_world: Array = grasp_map.positions + robot.tool_length * grasp_map.normals
        self.points = grasp_map.positions.copy()
        self.normals = np.ascontiguousarray(grasp_map.normals)
        self.rails = np.ascontiguousarray(grasp_map.rotations[:, :, 0])
        self.folds = np.array(robot.folds)
        self.shapes = LimbShapes(robot)
        self.collision_model = CollisionModel(self.shapes, grasp_map.boxes, settings.clearance)
        self.point_cause = np.zeros(len(grasp_map), dtype=np.int64)
        if settings.collisions:
            model = self.collision_model.arrays
            hands_clear(
                self.points, self.normals, robot.tool_length, self.lengths, model, self.point_cause
            )
        self._alone = CollisionModel(self.shapes, (), settings.clearance)
        self._rows: dict[bytes, int] = {}
        self._solved = _Table(robot.limbs)

    @property
    def geometries(self) -> int:
        """Number of relative geometries solved so far."""
        return len(self._rows)

    def solve(self, stances: IntArray) -> Postures:
        """Postures of stances given as point indices, shape (k, N)."""
        rows, inverse = relative_geometries(self.grasp_map, stances)
        new: list[int] = []
        where = np.empty(len(rows), dtype=np.int64)
        for r, row in enumerate(rows):
            key = row.tobytes()
            found = self._rows.get(key)
            if found is None:
                found = self._rows[key] = len(self._rows)
                new.append(r)
            where[r] = found
        if new:
            self._solve_new(rows[np.array(new)])
        local = self._solved.take(where[inverse])
        frames = self.grasp_map.rotations[stances[:, 0]]
        postures = Postures(
            base_position=self.grasp_map.positions[stances[:, 0]]
            + np.einsum("kij,kj->ki", frames, local.base_position),
            base_rotation=frames @ local.base_rotation,
            w_m=local.w_m,
            w_b=local.w_b,
            branch=local.branch,
            mask=local.mask,
            cause=local.cause,
        )
        if self.settings.collisions:
            self._avoid_boxes(stances, postures)
        return postures

    def _avoid_boxes(self, stances: IntArray, postures: Postures) -> None:
        """Take branches that touch a box out of the postures.

        Where those of the posture itself do, another posture is chosen.
        """
        nodes = np.flatnonzero(np.all(postures.mask > 0, axis=1))
        touching = self.point_cause[stances[nodes]].max(axis=1)
        postures.cause[nodes] = touching
        postures.mask[nodes[touching > 0]] = 0
        nodes = nodes[touching == 0]
        in_parallel(
            len(nodes), clear_of_world, nodes, stances, self.points, self.normals,
            self.robot.tool_length,
            postures.base_position, postures.base_rotation, postures.branch, postures.mask,
            self.settings.transitions,
            self.mount_rotations, self.mount_positions, self.lengths, self.collision_model.arrays,
            postures.cause,
        )  # fmt: skip
        again = nodes[postures.cause[nodes] > 0]
        if not len(again):
            return
        held = stances[again]
        centres = self.points[held].mean(axis=1)
        rotations = self.grasp_map.rotations[held]
        new = self._solve_in_place(
            Grasps(
                self.points[held] - centres[:, None], np.ascontiguousarray(rotations[..., 2]),
                np.ascontiguousarray(rotations[..., 0]), centres,
            ), self.collision_model, avoid=True,
        )  # fmt: skip
        better = np.all(new.mask > 0, axis=1)
        postures.mask[again] = 0
        for name in FIELDS:
            getattr(postures, name)[again[better]] = getattr(new, name)[better]
        postures.base_position[again[better]] += centres[better]

    def _solve_new(self, rows: IntArray) -> None:
        grasps, centroid = grasps_of_geometries(rows, self.robot.limbs)
        out = self._solve_in_place(grasps, self._alone, avoid=False)
        out.base_position[:] += centroid
        self._solved.append(out)

    def _scales(self) -> tuple[float, float]:
        """Limb and base manipulability that count as margin 1."""
        given = self.settings.thresholds(self.robot.limbs)
        default = Settings().thresholds(self.robot.limbs)
        return given[0] or default[0], given[1] or default[1]

    def at(
        self,
        stance: Sequence[int],
        position: Array,
        rotation: Array,
        collisions: bool | None = None,
    ) -> Postures:
        """The posture of one stance, given by point indices, at a given base pose.

        Thresholds do not apply there, the floor of departures does.

        Args:
            stance: Point index of each limb.
            position: Base position in the world [m], shape (3,).
            rotation: Base rotation in the world, shape (3, 3).
            collisions: Whether branches that touch something are left out; by default as in the
                settings.
        """
        held, settings = np.array([stance], dtype=np.int64), self.settings
        collisions = settings.collisions if collisions is None else collisions
        rotations = self.grasp_map.rotations[held]
        normals = np.ascontiguousarray(rotations[..., 2])
        rails = np.ascontiguousarray(rotations[..., 0])
        centre = self.points[held].mean(axis=1)
        away = position - centre[0]
        height = float(np.linalg.norm(away))
        up = rotation[:, 2] if height < 1e-9 else away / height
        frames = (
            rotation[None].copy(),
            up[None].copy(),
            up[None].copy(),
            np.zeros(1, dtype=np.bool_),
        )
        heights, rolls = np.array([height]), np.zeros(1)
        out = self._run(
            Grasps(self.points[held] - centre[:, None], normals, rails, centre),
            _Candidates(frames, heights, rolls, heights, rolls),
            self.collision_model if collisions else self._alone,
            thresholds=(0.0, 0.0),
            avoid=collisions,
            collisions=collisions,
        )
        out.base_position[:], out.base_rotation[:] = position, rotation
        if collisions and self.point_cause[held].any():
            out.mask[:] = 0
        return out

    def _solve_in_place(self, held: Grasps, model: CollisionModel, *, avoid: bool) -> Postures:
        """Postures among the robot's candidates, base positions from the grasps' centroids.

        With `avoid` the best posture of all is known to touch something.
        """
        robot, settings = self.robot, self.settings
        wide_rolls = np.array(
            geometric_order(2.0 * np.pi * np.arange(OPPOSED_ROLLS) / OPPOSED_ROLLS)
        )
        candidates = _Candidates(
            base_frames(held.grasps, held.normals, np.ascontiguousarray(held.rails[:, 0])),
            np.array(robot.heights),
            np.array(robot.rolls),
            np.array(OPPOSED_HEIGHTS),
            wide_rolls,
        )
        return self._run(
            held,
            candidates,
            model,
            thresholds=settings.thresholds(robot.limbs),
            avoid=avoid,
            collisions=settings.collisions,
        )

    def _run(
        self,
        held: Grasps,
        candidates: _Candidates,
        model: CollisionModel,
        *,
        thresholds: tuple[float, float],
        avoid: bool,
        collisions: bool,
    ) -> Postures:
        """The posture that the rule takes of some candidates, for each stance."""
        robot, settings = self.robot, self.settings
        k, count = held.grasps.shape[:2]
        tools = np.empty((k, count, 3, 3))
        tools[..., 0], tools[..., 2] = held.rails, -held.normals
        tools[..., 1] = np.cross(tools[..., 2], tools[..., 0])
        out = Postures(
            np.zeros((k, 3)), np.zeros((k, 3, 3)), np.zeros((k, count)), np.zeros(k),
            np.zeros((k, count), dtype=np.int64), np.zeros((k, count), dtype=np.int64),
            np.zeros(k, dtype=np.int64),
        )  # fmt: skip
        least = min(a / b for a, b in zip(thresholds, self._scales(), strict=True))
        in_parallel(
            k, solve_geometries, held.grasps, held.normals, tools, *candidates.frames,
            self.mount_rotations, self.mount_positions, self.lengths, self.limits, self.full_turn,
            robot.tool_length, robot.lift, robot.characteristic_length,
            *candidates[1:], *self._scales(), *thresholds, settings.path_floor,
            least * (1.0 - 3.0 * TIE), avoid,
            settings.transitions, collisions, held.centres, model.arrays,
            out.base_position, out.base_rotation, out.w_m, out.w_b, out.branch, out.mask, out.cause,
        )  # fmt: skip
        return out


class _Table:
    """Solved postures in arrays that grow by doubling."""

    def __init__(self, limbs: int) -> None:
        shapes: list[tuple[tuple[int, ...], type]] = [
            ((3,), float), ((3, 3), float), ((limbs,), float), ((), float), ((limbs,), np.int64),
            ((limbs,), np.int64),
            ((), np.int64),
        ]  # fmt: skip
        self._arrays: list[NDArray[Any]] = [
            np.zeros((0, *shape), dtype=kind) for shape, kind in shapes
        ]
        self._used = 0

    def append(self, new: Postures) -> None:
        parts = [getattr(new, name) for name in FIELDS]
        end = self._used + len(new.w_b)
        for i, part in enumerate(parts):
            if end > len(self._arrays[i]):
                grown = np.zeros(
                    (max(end, 2 * len(self._arrays[i])), *part.shape[1:]), dtype=part.dtype
                )
                grown[: self._used] = self._arrays[i][: self._used]
                self._arrays[i] = grown
            self._arrays[i][self._used : end] = part
        self._used = end

    def take(self, index: IntArray) -> Postures:
        return Postures(*(array[index] for array in self._arrays))


def tool_rotations(grasp_map: GraspMap) -> Array:
    """Flange rotations in the world that grasp each point, flip 0, shape (m, 3, 3).

    The x axis lies along the rail, the z axis points into the surface.
    """
    rotations = grasp_map.rotations
    return np.stack([rotations[:, :, 0], -rotations[:, :, 1], -rotations[:, :, 2]], axis=2)
