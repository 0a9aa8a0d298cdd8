"""How releases and steps are checked: an object that every stance graph has.

Questions come in batches and are answered by compiled code, see `release` and `steps`; nothing is
remembered here. Graphs keep the answers: for two limbs in a table, for more by stance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.compiled.kernels import in_parallel
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.transitions.records import (
    ReleaseRecord,
    StanceSet,
    StepContext,
    StepRecord,
    StepScratch,
    WorldRecord,
)
from mlivr_gym.transitions.relaxed_steps import may_keep_all
from mlivr_gym.transitions.release import release_all
from mlivr_gym.transitions.steps import check_all, hold_all

LEAST_IN_THREADS = 64
"""Releases or steps from which on they are checked in threads."""


class StepChecks:
    """The check of releases and steps of a robot on a map.

    Attributes
    ----------
    solver
        The robot, the map and its boxes, and what stances and steps must meet.
    robots
        The robot as compiled code reads it, a row of `Robot`, shape (1,).
    """

    def __init__(self, solver: PostureSolver) -> None:
        """Check steps of the robot of `solver`."""
        self.solver = solver
        self.robots = solver.shapes.rows
        self._idle: list[Any] = []
        """Scratch that no check uses at present."""

    def ignore_joint_limits(self) -> None:
        """From now on joints of limbs that hold may leave their windows, to see what that costs."""
        self.robots = self.robots.copy()
        self.robots["limbs"]["arm"]["window"][..., 1] = np.inf

    def world(self, obstacles: BoxGrid | None, again: bool = False) -> WorldRecord:
        """What motions are checked against.

        Parameters
        ----------
        obstacles
            Boxes besides those of the map, if there are any.
        again
            Whether the answers on the map are known, and only their motions are checked
            among the obstacles.
        """
        solver = self.solver
        stop = 0 if not solver.settings.collisions else 1 if obstacles is None else 2
        boxes = solver.boxes
        return WorldRecord(
            solver.grasps, boxes, obstacles or boxes, solver.thresholds, int(again), stop
        )

    def stances(self, points: IntArray, postures: Postures) -> StanceSet:
        """Stances with their postures, of which it is not known yet what can be released there."""
        points = np.ascontiguousarray(points, dtype=np.int64)
        return StanceSet(points, postures.base_rows, postures.mask, self.released(postures.mask))

    def released(self, mask: IntArray) -> Any:
        """Rows of `ReleaseRecord`, unknown; without collisions every branch is released."""
        out = ReleaseRecord.rows(*mask.shape)
        if not self.solver.settings.collisions:
            out["branches"], out["known"] = mask, True
        return out

    def _run(self, count: int, entry: Callable[..., None], rows: Any, scene: StepContext) -> None:
        """Call an entry over some rows; for a few, as searches ask, on scratch that is kept."""
        if count >= LEAST_IN_THREADS:
            in_parallel(
                count, entry, rows, scene, scratch_rows=StepScratch.rows, least=LEAST_IN_THREADS
            )
        elif count:
            scratch = self._idle.pop() if self._idle else StepScratch.rows(1)
            entry(0, count, rows, scene, scratch)
            self._idle.append(scratch)

    def release(self, stances: StanceSet, todo: IntArray, world: WorldRecord) -> None:
        """Work out what can be released; `todo` are stances and limbs, shape (k, 2)."""
        self._run(len(todo), release_all, todo, StepContext(stances, self.robots, world))

    def steps(self, count: int) -> Any:
        """Rows of `StepRecord` to be filled."""
        steps = StepRecord.rows(count)
        steps["wanted"] = ALL
        return steps

    def hold(self, steps: Any, stances: StanceSet, world: WorldRecord) -> Any:
        """Which steps the limbs that hold can follow on some base path, shape (k,)."""
        self._run(len(steps), hold_all, steps, StepContext(stances, self.robots, world))
        return steps["kept"].any(axis=1)

    def check(self, steps: Any, stances: StanceSet, world: WorldRecord) -> None:
        """Check steps, each between two of some stances; what is found is written into them."""
        self._run(len(steps), check_all, steps, StepContext(stances, self.robots, world))

    def may_keep(self, steps: Any, stances: StanceSet, world: WorldRecord) -> None:
        """Write into steps what they may keep at most on any of the branches wanted."""
        self._run(len(steps), may_keep_all, steps, StepContext(stances, self.robots, world))
