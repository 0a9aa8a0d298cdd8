"""Postures: the base pose that belongs to a stance.

Body z lies along the mean outward normal of the held points, for two limbs along its part across
the line through the grasps; yaw (and, for N > 2, which way round) follows from the Procrustes fit
of the mounts' azimuths to the grasps; the origin is the grasps' centroid plus a height along that
direction. Candidates are heights, rolls about the line through the grasps, and the branches of each
limb. Between opposite walls the mean normal vanishes: there the body rolls all the way round that
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
the posture differs only where the rule's choice comes too near something.

But for the surroundings, the result depends on the relative geometry of the grasps alone. It is
worked out in the frame of the first grasp on figures rounded to `RESOLUTION`, once for each
geometry; where that posture touches the surroundings, the candidates are tried once more in place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.collisions.collision_model import CollisionModel
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.queries import clear_of_world, hands_clear
from mlivr_gym.compiled.kernels import in_parallel
from mlivr_gym.postures.rule import TIE
from mlivr_gym.postures.selection import solve_geometries
from mlivr_gym.robot.specification import RobotSpec, geometric_order
from mlivr_gym.settings import Settings
from mlivr_gym.world.grasp_map import GraspMap

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

RESOLUTION = 1e-7
"""Relative positions [m] and directions that agree within this count as equal."""

OPPOSED = 0.2
"""Mean normals shorter than this belong to stances between opposite walls."""

OPPOSED_HEIGHTS = (0.15, 0.25, 0.35, 0.45)
"""Distances of the base from the line through the grasps tried there [m]."""

OPPOSED_ROLLS = 12
"""Rolls over the full circle tried there."""


@dataclass(frozen=True)
class Postures:
    """Postures of k stances.

    Attributes:
        position: Base positions [m], shape (k, 3).
        rotation: Base rotations, shape (k, 3, 3).
        w_m: Limb manipulability, shape (k, N); 0 where the stance cannot be held.
        w_b: Base manipulability, shape (k,).
        branch: Branch of each limb that gives the margin, shape (k, N).
        mask: Branches and flips each limb may hold on, 16-bit masks, shape (k, N).
        cause: What the best posture touches where that alone keeps the stance from being held,
            shape (k,); see `collision_kernels`.
    """

    position: Array
    rotation: Array
    w_m: Array
    w_b: Array
    branch: IntArray
    mask: IntArray
    cause: IntArray

    @property
    def reachable(self) -> NDArray[np.bool_]:
        """Whether inverse kinematics has a solution, shape (k,)."""
        reachable: NDArray[np.bool_] = (self.w_b > 0.0) | (self.cause > 0)
        return reachable

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Postures:
        """Postures of the chosen stances."""
        return Postures(*(getattr(self, name)[index] for name in FIELDS))


FIELDS = tuple(field.name for field in fields(Postures))
"""Names of a posture's arrays."""


def base_frames(
    grasps: Array, normals: Array, rails: Array
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Unrolled body axes of stances.

    Two limbs: x along the line through the grasps, z along the mean normal's part across that line.
    More limbs: z along the mean normal, or against it where that order of the mounts fits better; x
    by the Procrustes fit.

    Args:
        grasps: Held points from their centroid [m], shape (k, N, 3).
        normals: Shape (k, N, 3).
        rails: Rail directions at the first grasps, shape (k, 3).

    Returns:
        Body axes as columns, shape (k, 3, 3); outward directions (k, 3); roll axes (k, 3); whether
        the held walls are opposed (k,).
    """
    count = grasps.shape[1]
    line = grasps[:, 0].copy()
    degenerate = (line**2).sum(axis=1) < 1e-12
    line[degenerate] = rails[degenerate]
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    out = normals.mean(axis=1)
    if count == 2:
        out = _across(out, line)
    opposed = (out**2).sum(axis=1) < OPPOSED**2
    sides = np.cross(normals[:, 0], rails)
    around = _across(rails, line)
    along_rail = (around**2).sum(axis=1) < 1e-6
    around[along_rail] = _across(sides, line)[along_rail]
    out[opposed] = around[opposed]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    e1 = _across(rails, out)
    upright = (e1**2).sum(axis=1) < 1e-6
    e1[upright] = _across(sides, out)[upright]
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    e2 = np.cross(out, e1)
    mounts = np.exp(-2j * np.pi * np.arange(count) / count)
    grasp = np.einsum("kni,ki->kn", grasps, e1) + 1j * np.einsum("kni,ki->kn", grasps, e2)
    fit, mirrored = grasp @ mounts, grasp.conj() @ mounts
    other = np.abs(mirrored) > np.abs(fit) * (1.0 + TIE) + TIE
    yaw = np.angle(np.where(other, mirrored.conj(), fit))[:, None]
    x = np.cos(yaw) * e1 + np.sin(yaw) * e2
    z = np.where(other[:, None], -out, out)
    return np.stack([x, np.cross(z, x), z], axis=2), out, line, opposed


def _across(vectors: Array, axes: Array) -> Array:
    """Parts of `vectors` at right angles to the unit `axes`, both (k, 3)."""
    return vectors - axes * (vectors * axes).sum(axis=1, keepdims=True)


class PostureSolver:
    """Postures of stances on a map, each relative geometry solved once."""

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Keep the figures of map, robot and thresholds in the kernels' form."""
        self.grasp_map, self.robot, self.settings = grasp_map, robot, settings
        self.mount_rotations = robot.mount_rotations
        self.mount_positions = robot.mount_positions
        self.lengths = robot.limb.lengths
        self.limits, self.full_turn = robot.limb.limits, robot.full_turn
        self.tools = tool_rotations(grasp_map)
        self.flanges: Array = grasp_map.positions + robot.tool_length * grasp_map.normals
        """Flange position at each grasp [m], shape (m, 3)."""
        self.points, self.normals = (
            grasp_map.positions.copy(),
            np.ascontiguousarray(grasp_map.normals),
        )
        self.rails, self.folds = (
            np.ascontiguousarray(grasp_map.rotations[:, :, 0]),
            np.array(robot.folds),
        )
        self.shapes = LimbShapes(robot)
        self.collision_model = CollisionModel(self.shapes, grasp_map.boxes, settings.clearance)
        self.point_cause = np.zeros(len(grasp_map), dtype=np.int64)
        """What a hand touches that holds each point, see `collision_kernels`; 0 if nothing, shape (m,)."""
        if settings.collisions:
            hands_clear(
                self.points, self.normals, robot.tool_length, self.lengths, self.collision_model.arrays,
                self.point_cause
            )  # fmt: skip
        self._alone = CollisionModel(self.shapes, (), settings.clearance)
        self._rows: dict[bytes, int] = {}
        self._solved = _Table(robot.limbs)

    @property
    def geometries(self) -> int:
        """Number of relative geometries solved so far."""
        return len(self._rows)

    def solve(self, stances: IntArray) -> Postures:
        """Postures of stances given as point indices, shape (k, N)."""
        rows, inverse = self._group(stances)
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
            position=self.grasp_map.positions[stances[:, 0]]
            + np.einsum("kij,kj->ki", frames, local.position),
            rotation=frames @ local.rotation,
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
        """Take branches that touch a box out of the postures, and choose another posture where the own ones do."""
        nodes = np.flatnonzero(np.all(postures.mask > 0, axis=1))
        touching = self.point_cause[stances[nodes]].max(axis=1)
        postures.cause[nodes] = touching
        postures.mask[nodes[touching > 0]] = 0
        nodes = nodes[touching == 0]
        in_parallel(
            len(nodes), clear_of_world, nodes, stances, self.points, self.normals,
            self.robot.tool_length,
            postures.position, postures.rotation, postures.branch, postures.mask,
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
            self.points[held] - centres[:, None], np.ascontiguousarray(rotations[..., 2]),
            np.ascontiguousarray(rotations[..., 0]), centres, self.collision_model, True,
        )  # fmt: skip
        better = np.all(new.mask > 0, axis=1)
        postures.mask[again] = 0
        for name in FIELDS:
            getattr(postures, name)[again[better]] = getattr(new, name)[better]
        postures.position[again[better]] += centres[better]

    def _group(self, stances: IntArray) -> tuple[IntArray, NDArray[np.intp]]:
        """Distinct relative geometries as whole multiples of `RESOLUTION`, and which one each stance has."""
        positions, rotations = self.grasp_map.positions, self.grasp_map.rotations
        first = stances[:, :1]
        frames = rotations[stances[:, 0]]
        moved = np.einsum("kij,kni->knj", frames, positions[stances[:, 1:]] - positions[first])
        normals = np.einsum("kij,kni->knj", frames, rotations[stances[:, 1:], :, 2])
        rails = np.einsum("kij,kni->knj", frames, rotations[stances[:, 1:], :, 0])
        rows = np.rint(np.concatenate([moved, normals, rails], axis=2) / RESOLUTION).astype(
            np.int64
        )
        rows = np.ascontiguousarray(rows.reshape(len(stances), -1))
        rng = np.random.default_rng(0)
        mix = rng.integers(1, 2**62, rows.shape[1], dtype=np.int64) | 1
        with np.errstate(over="ignore"):
            code = (rows * mix).sum(axis=1)
        _, index, inverse = np.unique(code, return_index=True, return_inverse=True)
        if not np.array_equal(rows[index[inverse]], rows):
            _, index, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        return rows[index], inverse

    def _solve_new(self, rows: IntArray) -> None:
        k, count = len(rows), self.robot.limbs
        blocks = rows.reshape(k, count - 1, 9) * RESOLUTION
        grasps = np.zeros((k, count, 3))
        normals, rails = np.zeros((k, count, 3)), np.zeros((k, count, 3))
        normals[:, 0, 2] = rails[:, 0, 0] = 1.0
        grasps[:, 1:] = blocks[:, :, :3]
        normals[:, 1:] = blocks[:, :, 3:6] / np.linalg.norm(
            blocks[:, :, 3:6], axis=2, keepdims=True
        )
        rails[:, 1:] = blocks[:, :, 6:] / np.linalg.norm(blocks[:, :, 6:], axis=2, keepdims=True)
        centroid = grasps.mean(axis=1, keepdims=True)
        out = self._solve_in_place(
            grasps - centroid, normals, rails, np.zeros((k, 3)), self._alone, False
        )
        out.position[:] += centroid[:, 0]
        self._solved.append(out)

    def _scales(self) -> tuple[float, float]:
        """Limb and base manipulability that count as margin 1."""
        given, default = (
            self.settings.thresholds(self.robot.limbs),
            Settings().thresholds(self.robot.limbs),
        )
        return given[0] or default[0], given[1] or default[1]

    def at(
        self,
        stance: Sequence[int],
        position: Array,
        rotation: Array,
        collisions: bool | None = None,
    ) -> Postures:
        """The posture of one stance, given by point indices, at a base pose of the robot's own.

        Thresholds do not apply there, the floor of departures does.

        Args:
            stance: Point index of each limb.
            position: Base position [m], shape (3,).
            rotation: Base rotation, shape (3, 3).
            collisions: Whether branches that touch something are left out; by default as in the
                settings.
        """
        held, settings = np.array([stance], dtype=np.int64), self.settings
        collisions = settings.collisions if collisions is None else collisions
        rotations = self.grasp_map.rotations[held]
        normals, rails = (
            np.ascontiguousarray(rotations[..., 2]),
            np.ascontiguousarray(rotations[..., 0]),
        )
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
        candidates = (np.array([height]), np.zeros(1), np.array([height]), np.zeros(1))
        collision_model = self.collision_model if collisions else self._alone
        out = self._run(
            self.points[held] - centre[:, None], normals, rails, centre, collision_model, collisions,
            collisions, frames, candidates,
            (0.0, 0.0),
        )  # fmt: skip
        out.position[:], out.rotation[:] = position, rotation
        if collisions and self.point_cause[held].any():
            out.mask[:] = 0
        return out

    def _solve_in_place(
        self,
        grasps: Array,
        normals: Array,
        rails: Array,
        centres: Array,
        collision_model: CollisionModel,
        avoid: bool,
    ) -> Postures:
        """Postures from the grasps' centroids; `centres` are these in the world of `collision_model`.

        With `avoid` the best posture of all is known to touch something.
        """
        robot, settings = self.robot, self.settings
        wide_rolls = np.array(
            geometric_order(2.0 * np.pi * np.arange(OPPOSED_ROLLS) / OPPOSED_ROLLS)
        )
        frames = base_frames(grasps, normals, np.ascontiguousarray(rails[:, 0]))
        candidates = (
            np.array(robot.heights),
            np.array(robot.rolls),
            np.array(OPPOSED_HEIGHTS),
            wide_rolls,
        )
        return self._run(
            grasps, normals, rails, centres, collision_model, avoid, settings.collisions, frames, candidates,
            settings.thresholds(robot.limbs),
        )  # fmt: skip

    def _run(
        self, grasps: Array, normals: Array, rails: Array, centres: Array, collision_model: CollisionModel,
        avoid: bool, collisions: bool,
        frames: tuple[Any, ...], candidates: tuple[Array, ...], thresholds: tuple[float, float],
    ) -> Postures:  # fmt: skip
        """The rule over candidates of heights and rolls (and those between opposite walls) about given frames."""
        robot, settings = self.robot, self.settings
        k, count = grasps.shape[:2]
        tools = np.empty((k, count, 3, 3))
        tools[..., 0], tools[..., 2] = rails, -normals
        tools[..., 1] = np.cross(tools[..., 2], tools[..., 0])
        out = Postures(
            np.zeros((k, 3)), np.zeros((k, 3, 3)), np.zeros((k, count)), np.zeros(k),
            np.zeros((k, count), dtype=np.int64), np.zeros((k, count), dtype=np.int64),
            np.zeros(k, dtype=np.int64),
        )  # fmt: skip
        least = min(a / b for a, b in zip(thresholds, self._scales(), strict=True))
        in_parallel(
            k, solve_geometries, grasps, normals, tools, *frames, self.mount_rotations,
            self.mount_positions,
            self.lengths, self.limits, self.full_turn, robot.tool_length, robot.lift,
            robot.characteristic_length,
            *candidates, *self._scales(), *thresholds, settings.path_floor,
            least * (1.0 - 3.0 * TIE), avoid,
            settings.transitions, collisions, centres, collision_model.arrays,
            out.position, out.rotation, out.w_m, out.w_b, out.branch, out.mask, out.cause,
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
    """Flange rotations that grasp each point, flip 0, shape (m, 3, 3): x along the rail, z into the surface."""
    rotations = grasp_map.rotations
    return np.stack([rotations[:, :, 0], -rotations[:, :, 1], -rotations[:, :, 2]], axis=2)
