"""The check of releases and steps, which every stance graph has.

Releases and steps are checked in batches by compiled code, see `release` and `steps`. Results are
stored by the graphs: for two limbs in a table, for more limbs by stance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.box_grid import BoxGrid
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.compiled.kernels import in_parallel
from mlivr_gym.compiled.scratch import ScratchPool
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.transitions.records import (
    ReleaseRecord,
    StanceArrays,
    StepContext,
    StepRecord,
    StepScratch,
    WorldRecord,
)
from mlivr_gym.transitions.relaxed_steps import relax_all
from mlivr_gym.transitions.release import release_all
from mlivr_gym.transitions.steps import check_all, check_supports, look_all

SCRATCH = ScratchPool(StepScratch)
"""Scratch of all checks."""

LEAST_IN_THREADS = 8
"""Number of releases or steps from which on threads are used; each takes about 0.1 ms."""


class StepChecks:
    """The check of releases and steps of a robot on a map.

    `robots` is the robot as compiled code reads it, a row of `RobotModel`, shape (1,).
    """

    def __init__(self, solver: PostureSolver) -> None:
        """Check steps of the robot of `solver`."""
        self.solver = solver
        self.robots = solver.shapes.rows

    def world(self, obstacles: BoxGrid | None, obstacles_only: bool = False) -> WorldRecord:
        """Return the world that motions are checked against: the map, and obstacles if any.

        With `obstacles_only` the results on the map are known, and only their motions are checked
        among the obstacles.
        """
        solver = self.solver
        stop = 0 if not solver.settings.collisions else 1 if obstacles is None else 2
        boxes = solver.boxes
        return WorldRecord(
            solver.grasps, boxes, obstacles or boxes, solver.thresholds, int(obstacles_only), stop
        )

    def stances(self, points: IntArray, postures: Postures) -> StanceArrays:
        """Return stances with their postures, whose releases are not known yet."""
        points = np.ascontiguousarray(points, dtype=np.int64)
        return StanceArrays(
            points,
            postures.base_rows,
            postures.branch_sets,
            self.unknown_releases(postures.branch_sets),
        )

    def unknown_releases(self, branch_sets: IntArray) -> Any:
        """Return unknown rows of `ReleaseRecord`.

        Without collision checks every branch is released.
        """
        out = ReleaseRecord.rows(*branch_sets.shape)
        if not self.solver.settings.collisions:
            out["branches"], out["known"] = branch_sets, True
        return out

    def _run(self, count: int, entry: Callable[..., None], rows: Any, scene: StepContext) -> None:
        """Call an entry for some rows, in threads if they are many, with scratch that is reused."""
        if count:
            with SCRATCH.borrowed() as scratch:
                in_parallel(count, entry, rows, scene, scratch_rows=scratch, least=LEAST_IN_THREADS)

    def release(self, stances: StanceArrays, todo: IntArray, world: WorldRecord) -> None:
        """Compute releases; `todo` has stances and limbs, shape (k, 2)."""
        self._run(len(todo), release_all, todo, StepContext(stances, self.robots, world))

    def steps(self, stances: StanceArrays, before: IntArray, after: IntArray) -> Any:
        """Return rows of `StepRecord` to be checked, shape (k,), for steps between rows of stances.

        Limbs may be on all branches that both stances have.
        """
        steps, points = StepRecord.rows(len(after)), stances.points
        moves = points[after] != points[before]
        steps["limb"], steps["before"], steps["after"] = moves.argmax(axis=1), before, after
        steps["kept"] = ALL
        return steps

    def can_follow(self, steps: Any, stances: StanceArrays, world: WorldRecord) -> Any:
        """Return for which steps supports follow in the first middles, as they must, shape (k,)."""
        looked = steps.copy()
        self._run(len(steps), check_supports, looked, StepContext(stances, self.robots, world))
        return looked["kept"].any(axis=1)

    def look(self, steps: Any, stances: StanceArrays, world: WorldRecord) -> None:
        """Leave of the branches that steps keep those that are clear in places, see `look_all`."""
        self._run(len(steps), look_all, steps, StepContext(stances, self.robots, world))

    def check(self, steps: Any, stances: StanceArrays, world: WorldRecord) -> None:
        """Check steps between stances; the results are written into them."""
        self._run(len(steps), check_all, steps, StepContext(stances, self.robots, world))

    def relax(self, steps: Any, stances: StanceArrays, world: WorldRecord) -> None:
        """Write into steps the branches that they keep at most, see `relaxed_steps`."""
        self._run(len(steps), relax_all, steps, StepContext(stances, self.robots, world))
