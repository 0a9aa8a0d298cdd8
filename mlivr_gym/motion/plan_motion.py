"""Configurations of the robot along the steps of a plan, without time.

`simulation.timing` adds time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.errors import PlanError
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.path_segments import path_segments
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.schema import Integer
from mlivr_gym.stances.stance_graph import StanceGraph


@dataclass(frozen=True)
class StepMotion:
    """k configurations along one step."""

    phase: IntArray
    """Index into `PHASES`, shape (k,)."""
    base_positions: Array
    """Base positions in the world, shape (k, 3) [m]."""
    base_quaternions: Array
    """Base orientations in the world w, x, y, z, shape (k, 4)."""
    joint_positions: Array
    """Joint angles, shape (k, N, 6) [rad]."""


@checked({**ARGUMENTS, "samples": Integer(2, 100_000)})
def step_motion(graph: StanceGraph, plan: Plan, index: int, samples: int = 50) -> StepMotion:
    """Compute configurations along one step of a plan that was made with collision checks.

    The swing limb departs along the surface normal, follows the knots of its swing while the base
    follows its path, and approaches along the other normal. The support limbs follow the base on
    their branches. There are `samples` configurations on the departure, on the approach, and on
    each line of the swing, whose ends adjacent lines share. The graph is that of the plan's robot
    and map. Raises a `PlanError` if the plan has no step of this index, or the step has no swing.
    """
    step = planned_regrasp(graph, plan, index)
    if not len(step.knots):
        raise PlanError(f"step {index} has no swing; make the plan with collisions=True")
    return path_motion(RegraspPath(graph, step), samples)


def path_motion(path: RegraspPath, samples: int) -> StepMotion:
    """Compute configurations along a regrasp, as `step_motion` does."""
    segments = path_segments(path, samples)
    return StepMotion(
        np.concatenate([np.full(len(one.sigmas), one.phase) for one in segments]),
        np.concatenate([one.base_positions for one in segments]),
        np.concatenate([one.base_quaternions for one in segments]),
        np.concatenate([one.joints for one in segments]),
    )
