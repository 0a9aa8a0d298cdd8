"""Compile the planner's kernels: `python -m mlivr_gym.planners.warmup`.

`stance_graph` starts this beside the graph's kernels where the cache is empty. It plans one step on
four points with postures that need no kernel, so that exactly what a plan needs is compiled, with
the types a plan uses.
"""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.planners import Planner
from mlivr_gym.postures.base_frames import base_frames
from mlivr_gym.postures.solver import Postures, PostureSolver
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.settings import Settings
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.transitions.rule import BRANCH_BITS
from mlivr_gym.world.grasp_map import jem_map

POINTS = ("F3a:2", "F3a:4", "F3b:2", "F3b:4")
HEIGHT = 0.65


class PlainSolver(PostureSolver):
    """Base poses at one height, with every branch, good or not."""

    def solve(self, stances: IntArray) -> Postures:
        """Postures of stances given as point indices, shape (k, 2)."""
        grasps = self.grasp_map.positions[stances]
        centroid = grasps.mean(axis=1)
        rails = self.grasp_map.rotations[stances[:, 0], :, 0]
        frames, out, _, _ = base_frames(
            grasps - centroid[:, None], self.grasp_map.normals[stances], rails
        )
        count = len(stances)
        return Postures(
            base_position=centroid + HEIGHT * out,
            base_rotation=frames,
            w_m=np.ones((count, 2)),
            w_b=np.ones(count),
            branch=np.zeros((count, 2), dtype=np.int64),
            mask=np.full((count, 2), BRANCH_BITS, dtype=np.int64),
            cause=np.zeros(count, dtype=np.int64),
        )


class PlainGraph(PairGraph):
    """A graph of such postures."""

    solver_class = PlainSolver


def main() -> None:
    """Plan from one stance to another, and search backward as plans do that explore much."""
    full = jem_map()
    graph = PlainGraph(full.subset(np.isin(full.ids, POINTS)), robot_spec("mlivr2"), Settings())
    goal = graph.posture(graph.indices(("F3a:4", "F3b:2"))).base_position[0].tolist()
    for cost in ("base", "steps"):
        planner = Planner(graph)
        planner.plan(("F3a:4", "F3b:4"), goal, cost, goal_tolerance=0.01)
        planner.cost_to_go(goal, cost, goal_tolerance=0.01)


if __name__ == "__main__":
    main()
