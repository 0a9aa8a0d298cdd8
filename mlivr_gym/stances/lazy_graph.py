"""Stance graph of any number of limbs, whose neighbours are worked out when asked for."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.solver import OPPOSED_HEIGHTS
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.records import StanceSet
from mlivr_gym.world.grasp_map import GraspMap


class LazyGraph(StanceGraph):
    """Stance graph of any number of limbs, whose neighbours are worked out when asked for."""

    def __init__(self, grasp_map: GraspMap, robot: RobotSpec, settings: Settings) -> None:
        """Start with nothing known."""
        super().__init__(grasp_map, robot, settings)
        self._released: dict[tuple[bytes, int], Any] = {}

    def postures(self, stances: IntArray) -> Postures:
        """Postures of stances, shape (k, N), feasible or not.

        Stances that touch an obstacle or hold an occupied point cannot be held.
        """
        stances = self.rows_of_points(stances)
        found = super().postures(stances)
        if self.obstacles:
            self.clear_of_obstacles(np.arange(len(stances)), stances, found)
        if self.occupied:
            found.mask[np.isin(stances, list(self.occupied)).any(axis=1)] = 0
        return found

    def _know_released(self, stances: StanceSet, todo: IntArray) -> None:
        """See `StanceGraph`; answers are remembered."""
        new = []
        for row, limb in todo.tolist():
            key = (stances.points[row].tobytes() + stances.base[row].tobytes(), limb)
            found = self._released.get(key)
            if found is None:
                new.append((row, limb, key))
            else:
                stances.released[row, limb] = found
        super()._know_released(
            stances, np.array([k[:2] for k in new], dtype=np.int64).reshape(-1, 2)
        )
        for row, limb, key in new:
            self._released[key] = stances.released[row, limb].copy()

    def _obstacles_changed(self) -> None:
        self._released = {}

    def candidates(self, stance: tuple[int, ...]) -> tuple[IntArray, IntArray, Postures]:
        """Feasible neighbouring stances, steps not yet checked; see `StanceGraph.candidates`."""
        limbs: list[IntArray] = []
        points: list[IntArray] = []
        for i in range(self.limbs):
            partners = [self.partners(p) for k, p in enumerate(stance) if k != i]
            common = partners[0]
            for other in partners[1:]:
                common = np.intersect1d(common, other, assume_unique=True)
            common = common[common != stance[i]]
            limbs.append(np.full(len(common), i, dtype=np.int64))
            points.append(common)
        limb, point = np.concatenate(limbs), np.concatenate(points)
        if not len(limb):
            return limb, point, self.postures(np.zeros((0, self.limbs), dtype=np.int64))
        stances = np.tile(np.array(stance, dtype=np.int64), (len(limb), 1))
        stances[np.arange(len(limb)), limb] = point
        postures = self.postures(stances)
        node = self.is_node(postures)
        return limb[node], point[node], postures.take(node)

    @property
    def max_step(self) -> float:
        """An upper bound of the base displacement of one step [m].

        The held grasps stay where they are and each lies within reach of the base before and after.
        Also the grasps' centroid moves at most `2 span / N`, and the base lies at most the largest
        height from it.
        """
        robot = self.robot
        height = max(max(map(abs, robot.heights)), max(OPPOSED_HEIGHTS))
        by_reach = 2.0 * (robot.mount_radius + robot.limb.reach + robot.tool_length)
        return min(by_reach, 2.0 * robot.span / self.limbs + 2.0 * height)
