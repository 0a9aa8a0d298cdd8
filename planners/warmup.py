"""Compilation of the kernels that a first plan needs: `python -m mlivr_gym.planners.warmup`.

`stance_graph` starts this in a process of its own if nothing is compiled yet. It plans on four
points with postures that need no kernel, so that the kernels of a plan are compiled for the types
that a plan uses.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.compiled.warming import reporting
from mlivr_gym.planners import Planner
from mlivr_gym.postures.base_poses import bases_at
from mlivr_gym.postures.postures import Postures
from mlivr_gym.postures.solver import PostureSolver
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.world.grasp_map import jem_map

POINTS = ("F3a:2", "F3a:4", "F3b:2", "F3b:4")
NUMBER = 1
"""The second candidate base pose: 0.65 m over the grasps."""


class PlainSolver(PostureSolver):
    """A posture solver that takes one candidate base pose, with every branch feasible."""

    def causes_at_points(self, grid: object) -> IntArray:
        """Return that no gripper touches anything, at any point."""
        return np.zeros(len(self.grasp_map), dtype=np.int64)

    def solve(self, stances: IntArray, *, nodes_only: bool = False) -> Postures:
        """Return postures of stances given as point indices, shape (k, 2)."""
        count = len(stances)
        base_position, base_rotation = bases_at(
            self.grasp_map, self.robot, stances, np.full(count, NUMBER)
        )
        return Postures(
            base_position=base_position,
            base_rotation=base_rotation,
            w_m=np.ones((count, 2)),
            w_b=np.ones(count),
            branch=np.zeros((count, 2), dtype=np.int64),
            branch_sets=np.full((count, 2), ALL, dtype=np.int64),
            pose_number=np.full(count, -1),
            cause=np.zeros(count, dtype=np.int64),
        )


class PlainGraph(TwoLimbGraph):
    """A stance graph of two limbs with such postures."""

    solver_class = PlainSolver


def main() -> None:
    """Plan from one stance to another, for both costs of the paper."""
    full = jem_map()
    graph = PlainGraph(full.subset(np.isin(full.ids, POINTS)), robot_spec("mlivr2"), Settings())
    goal = graph.posture(graph.indices(("F3a:4", "F3b:2"))).base_position[0].tolist()
    for cost in ("base", "steps"):
        Planner(graph).plan(("F3a:4", "F3b:4"), goal, cost, goal_tolerance=0.01)


if __name__ == "__main__":
    with reporting():
        main()
