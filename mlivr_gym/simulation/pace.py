"""How long a step should take: an estimate for a walk that failed because it was too fast.

At twice the duration a robot runs through the same configurations at half the speed, so that all
accelerations, and with them the torques they need and the lag of the controller, fall to a quarter:
they go with `1 / T^2`.
"""

from __future__ import annotations

import math

import numpy as np

from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_motion import step_trajectory
from mlivr_gym.motion.trajectory import Durations
from mlivr_gym.simulation.dynamics import Physics, dynamics_spec, torque_limits
from mlivr_gym.simulation.execution import Execution
from mlivr_gym.simulation.feedforward import feedforward
from mlivr_gym.simulation.scene import compiled
from mlivr_gym.stances.stance_graph import StanceGraph

MARGIN = 1.05
"""Factor on the duration for what is not modelled: grasps that yield, and the controller."""

SAMPLES = 300
"""Places on the time grid of a step at which torques are looked at."""


def longer_step(graph: StanceGraph, execution: Execution) -> float | None:
    """Duration of a step [s] at which a failed walk would probably succeed.

    Args:
        graph: The stance graph of the plan's robot and map.
        execution: A plan that was executed.

    Returns:
        An estimate, rounded up to tenths of a second, where a torque was at its limit, or a grasp
        was missed or lost its hold; None if time is not what the walk lacks.
    """
    failure = execution.failure
    if failure is None:
        return None
    if failure.kind in ("saturation", "lost hold"):
        over = torque_demand(graph, execution.plan, execution.durations, execution.physics)
    elif failure.kind == "missed grasp":
        values = failure.values
        over = max(
            values["distance_m"] / values["allowed_distance_m"],
            values["angle_rad"] / values["allowed_angle_rad"],
        )
    else:
        return None
    if failure.kind == "lost hold" and over < 1.0:
        return None
    return math.ceil(10.0 * MARGIN * math.sqrt(max(over, 1.0)) * execution.durations.total) / 10.0


def torque_demand(graph: StanceGraph, plan: Plan, durations: Durations, physics: Physics) -> float:
    """Largest torque that a plan needs of a joint by the robot's dynamics, over the joint's limit.

    Args:
        graph: The stance graph of the plan's robot and map.
        plan: The plan.
        durations: How long the parts of a step take.
        physics: Figures of the grasps.
    """
    model = compiled(dynamics_spec(graph.grasp_map, plan.world.robot, physics))
    largest = 0.0
    for index in range(len(plan.steps)):
        timed = step_trajectory(graph, plan, index, durations, durations.total / SAMPLES)
        torques, _ = feedforward(model, physics, timed)
        largest = max(largest, float((np.abs(torques) / torque_limits()).max()))
    return largest
