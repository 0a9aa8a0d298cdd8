"""The way of the base of two limbs: the joints of the only support go on one line."""

from __future__ import annotations

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.motion.joint_path import flange_in_body
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.line_steps import line_clear


class SupportLine:
    """A support whose joints go from the hold before a step to that after it on one line.

    All that `transitions.line_steps` checks is such lines of both limbs, and so is all that is
    committed. See `swings.Supports`.
    """

    def __init__(self, graph: StanceGraph, ends: StepEnds) -> None:
        """Prepare a step of two limbs with given ends."""
        self._ends, self._support = ends, 1 - ends.limb
        self._robots, self._world = graph.checks.robots, graph.checks.world(graph.obstacle_grid)
        self._lines = LineScratch.rows(1)
        line = self._lines[0]["line"]
        self._first, self._last = line["first"]["q"][:2], line["last"]["q"][:2]
        place, turn = flange_in_body(graph.robot, self._support, ends.joints[0, self._support])
        line["grasp"]["position"] = ends.positions[0] + ends.rotations[0] @ place
        line["grasp"]["rotation"] = ends.rotations[0] @ turn
        line["leader"] = self._support

    def is_clear(self, a: Array, b: Array) -> bool:
        """Return whether the robot keeps the clearance on the line between two swing knots."""
        self._first[:], self._last[:] = self.knots(a, b)
        clear = line_clear(self._support, self._ends.limb, self._robots, self._world, self._lines)
        return bool(clear)

    def knots(self, a: Array, b: Array) -> Array:
        """Return the two knots of the line between two swing knots, shape (2, 2, 6) [rad]."""
        joints = np.empty((2, 2, 6))
        first, last = self._ends.joints[:, self._support]
        for k, knot in enumerate((a, b)):
            joints[k, self._support] = (1.0 - knot[0]) * first + knot[0] * last
            joints[k, self._ends.limb] = knot[1:]
        return joints
