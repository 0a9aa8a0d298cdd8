"""Obstacles and occupied points, which change after a stance graph is made."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from contextlib import suppress
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import InstanceOf, Reader, checked
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.collisions.box_grid import BoxGrid, box_grid
from mlivr_gym.compiled.kernels import entry
from mlivr_gym.errors import SettingError, ShapeError
from mlivr_gym.kinematics.batches import SLACK
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath, ListOf, OrNone, Text
from mlivr_gym.settings import Settings
from mlivr_gym.sharing import Locked, new_lock
from mlivr_gym.transitions.step_check import StepChecks
from mlivr_gym.values import MAX_PARTS
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.given_points import STANCE
from mlivr_gym.world.grasp_map import GraspMap

GROUP_EDGE = 0.3
"""Edge of cubes whose obstacles are compared with positions as one box; 1 is the reach."""

OBSTACLE_CELL_EDGE = 0.6
"""Edge of the grid cells of obstacles [m]; affects the speed only."""

CELL_EDGE = 0.1
"""Edge of the cells whose positions are compared with obstacles as one [m]."""

IDS = ListOf(Text())
"""Validator of ids of boxes."""


def _points(value: object, place: FieldPath) -> tuple[str | int, ...]:
    with suppress(TypeError):  # an array without axes
        if isinstance(value, Iterable) and not isinstance(value, (str, bytes)):
            value = list(islice(value, MAX_PARTS + 1))  # some never end
    return STANCE.read(value, place)


POINTS = Reader(_points)
"""Validator of some points by id or index: a list, a set or what else has them one by one."""


def _boxes(value: object, place: FieldPath) -> tuple[Box, ...]:
    if isinstance(value, (list, tuple)) and all(isinstance(box, Box) for box in value):
        return tuple(value)
    return ListOf(InstanceOf(Box)).read(value, place)


BOXES = Reader(_boxes)
"""Validator of a list of boxes; thousands take a fraction of the time of `ListOf`."""


class PositionCells(NamedTuple):
    """Positions by cells of a grid, which are compared with obstacles in place of them."""

    cell: NDArray[np.int32]
    """Cell of each position, shape (n,)."""
    low: Array
    """Lower corner of each cell [m], shape (c, 3)."""

    @classmethod
    def of(cls, positions: Array) -> PositionCells:
        """Return the cells of positions, shape (n, 3) [m]."""
        if not len(positions):
            return cls(np.zeros(0, dtype=np.int32), np.zeros((0, 3)))
        columns = [column / CELL_EDGE for column in positions.T]
        first = np.floor([column.min() for column in columns])
        x, y, z = ((one - at).astype(np.int32) for one, at in zip(columns, first, strict=True))
        shape = tuple(int(one.max()) + 1 for one in (x, y, z))
        has_positions, place = np.zeros(shape, dtype=np.bool_), (x * shape[1] + y) * shape[2] + z
        has_positions.reshape(-1)[place] = True
        number = np.cumsum(has_positions, dtype=np.int32) - 1
        low: Array = np.ascontiguousarray(np.argwhere(has_positions) + first)
        return cls(number[place], CELL_EDGE * low)


@entry
def mark_close_cells(low: Array, bounds: Array, reach: float, close: BoolArray) -> None:
    """Mark the cells within `reach` of one of some boxes.

    The lower corners of the cells have shape (c, 3), the bounds of the boxes (g, 2, 3) [m].
    """
    for c in range(len(low)):
        for g in range(len(bounds)):
            square = 0.0
            for axis in range(3):
                above = bounds[g, 0, axis] - (low[c, axis] + CELL_EDGE)
                gap = max(low[c, axis] - bounds[g, 1, axis], above, 0.0)
                square += gap * gap
            if square <= reach * reach:
                close[c] = True
                break


class ChangingWorld(Locked, ABC):
    """A robot on a map whose obstacles and occupied points change.

    A copy, also a pickled one, has the same world, and computes anew what it needs.
    """

    def __init__(
        self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings, solver: PostureSolver
    ) -> None:
        """Start without obstacles and occupied points."""
        self.grasp_map, self.robot, self.settings = grasp_map, robot, settings
        self.solver = solver
        self.lock = new_lock()
        """Held by the thread that uses the graph, or a planner or environment on it."""
        self.obstacles: tuple[Box, ...] = ()
        """Boxes at present in addition to those of the map."""
        self.occupied: frozenset[int] = frozenset()
        """Indices of the points that may not be grasped at present."""
        self.version = 0
        """Number of changes of obstacles and occupied points."""
        self._last_removal = 0
        self.checks = StepChecks(solver)
        """The check of releases and steps."""
        self.obstacle_grid: BoxGrid | None = None
        """The obstacles as compiled code reads them, None if there are none."""
        self._touches_at: BoolArray | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy what the graph is made of and its world, and none of its results."""
        with self.lock:
            made_of = self.grasp_map, self.robot, self.settings
            return type(self), made_of, (self.obstacles, self.occupied, self.version)

    def __setstate__(self, world: tuple[Any, ...]) -> None:
        """Take the obstacles, the occupied points and the version of a world."""
        obstacles, occupied, version = world
        self._set_obstacles(obstacles, occupied)
        self.version = self._last_removal = version

    @checked({"boxes": BOXES, "replaced": IDS})
    def add_obstacles(self, boxes: Sequence[Box], *, replaced: Sequence[str] = ()) -> None:
        """Add boxes, which remove the stances and steps that touch them.

        Only what is within reach of them is computed again, on demand. Stances keep their postures.

        Boxes of the ids `replaced`, which were added before, are removed in the same change. Raises
        a `ShapeError` if the map or another obstacle has a box of the same id, or no obstacle has
        an id in `replaced`, and a `SettingError` if collisions are not checked.
        """
        if boxes and not self.settings.collisions:
            raise SettingError(
                "obstacles need collisions=True; this stance graph does not check collisions"
            )
        kept = self._without(replaced)
        ids = {box.id for box in (*self.grasp_map.boxes, *kept)}
        for box in boxes:
            if box.id in ids:
                raise ShapeError(f"a box {box.id!r} already exists; give each box an id of its own")
            ids.add(box.id)
        if boxes or replaced:
            self._set_obstacles((*kept, *boxes), self.occupied)

    @checked({"ids": OrNone(IDS)})
    def remove_obstacles(self, ids: Sequence[str] | None = None) -> None:
        """Remove boxes that were added, by default all.

        Raises a `ShapeError` if no obstacle has an id.
        """
        kept = () if ids is None else self._without(ids)
        self._set_obstacles(kept, self.occupied)

    def _without(self, ids: Sequence[str]) -> tuple[Box, ...]:
        """Return the obstacles except those of some ids, each of which must exist."""
        there = dict.fromkeys(box.id for box in self.obstacles)
        for name in ids:
            if name not in there:
                raise ShapeError(
                    f"no obstacle {name!r}; there are {', '.join(map(repr, there)) or 'none'}"
                )
        gone = set(ids)
        return tuple(box for box in self.obstacles if box.id not in gone)

    @checked({"points": POINTS})
    def occupy(self, points: Iterable[str | int]) -> None:
        """Make points, given by id or index, unavailable until they are vacated."""
        self._set_obstacles(
            self.obstacles, self.occupied | {self.grasp_map.index(point) for point in points}
        )

    @checked({"points": OrNone(POINTS)})
    def vacate(self, points: Iterable[str | int] | None = None) -> None:
        """Make points, given by id or index, available again, by default all."""
        if points is None:
            vacated = self.occupied
        else:
            vacated = frozenset(self.grasp_map.index(point) for point in points)
        self._set_obstacles(self.obstacles, self.occupied - vacated)

    def _set_obstacles(self, boxes: tuple[Box, ...], occupied: frozenset[int]) -> None:
        """Set the obstacles and occupied points, and forget what depended on them."""
        if boxes != self.obstacles:
            self.obstacle_grid = box_grid(boxes, OBSTACLE_CELL_EDGE) if boxes else None
            self._touches_at = None
        before = len(self.obstacles)
        is_more = boxes[:before] == self.obstacles and self.occupied <= occupied
        self.obstacles, self.occupied = boxes, frozenset(occupied)
        self.version += 1
        self._last_removal = self._last_removal if is_more else self.version
        self._world_changed()

    def has_all_since(self, version: int) -> bool:
        """Return whether all obstacles and occupied points of a version are still there."""
        return self._last_removal <= version

    @abstractmethod
    def _world_changed(self) -> None:
        """Forget results that are no longer valid."""

    def may_touch_obstacles(self, positions: Array) -> BoolArray:
        """Return whether robots with bases at rest at positions may touch one, (k, 3) -> (k,)."""
        close, grid = np.zeros(len(positions), dtype=np.bool_), self.obstacle_grid
        if grid is not None:
            bounds, reach = grid.boxes["bounds"], self.robot.extent + self.settings.clearance
            for low, high in zip(bounds["low"], bounds["high"], strict=True):
                gap = np.maximum(np.maximum(low - positions, positions - high), 0.0)
                close |= np.linalg.norm(gap, axis=1) <= reach + SLACK
        return close

    def close_to_obstacles(
        self, positions: PositionCells, reach: float, grid: BoxGrid | None = None
    ) -> BoolArray:
        """Return which positions, by their cells, may be within `reach` of obstacles, shape (n,).

        Boxes of a grid, by default all obstacles, whose centres are close to each other count as
        one that contains them.
        """
        close, grid = np.zeros(len(positions.low), dtype=np.bool_), grid or self.obstacle_grid
        if grid is not None:
            bounds = grouped_bounds(grid, GROUP_EDGE * reach)
            mark_close_cells(positions.low, bounds, reach + SLACK, close)
        return np.asarray(close[positions.cell])

    def among_obstacles(self, points: IntArray, postures: Postures) -> Postures:
        """Remove what obstacles and occupied points exclude from postures, and return them.

        The branch sets of the stances, given by their points, shape (k, N), are changed in place.
        """
        self.remove_branches_at_obstacles(points, postures)
        if self.occupied:
            postures.branch_sets[np.isin(points, list(self.occupied)).any(axis=1)] = 0
        return postures

    def remove_branches_at_obstacles(self, points: IntArray, postures: Postures) -> None:
        """Remove the branches that touch an obstacle from postures of stances, (k, N), in place."""
        if self.obstacle_grid is None:
            return
        every, checked = np.arange(len(points)), postures.checked(points, True)
        self.solver.remove_touching(every, checked, self.obstacle_grid)
        if self._touches_at is None:
            self._touches_at = self.solver.causes_at_points(self.obstacle_grid) > 0
        postures.branch_sets[self._touches_at[points].any(axis=1)] = 0


def grouped_bounds(grid: BoxGrid, edge: float) -> Array:
    """Return bounds of the boxes whose centres lie in the same cube of an edge [m], (g, 2, 3)."""
    if not len(grid.boxes):
        return np.zeros((0, 2, 3))
    places = np.floor(grid.boxes["centre"] / edge).astype(np.int64)
    places -= places.min(axis=0)
    cube = np.ravel_multi_index(tuple(places.T), tuple(places.max(axis=0) + 1))
    order = np.argsort(cube, kind="stable")
    begins = np.flatnonzero(np.diff(cube[order], prepend=-1))
    low, high = (grid.boxes["bounds"][name][order] for name in ("low", "high"))
    return np.stack([np.minimum.reduceat(low, begins), np.maximum.reduceat(high, begins)], axis=1)
