"""Recordings of executions that never were."""

from dataclasses import replace

import numpy as np

from mlivr_gym.simulation.recording import Recording

SHAPES = {
    "times": (), "base_errors": (), "base_angle_errors": (), "base_positions": (3,),
    "base_quaternions": (4,), "module_forces": (3,), "module_torques": (3,),
    "momenta": (3,), "angular_momenta": (3,),
}  # fmt: skip


def resting(count, limbs=2):
    """A recording of `count` samples in which everything is zero."""
    each = {"joint_positions": 6, "joint_torques": 6, "grasp_forces": 3, "grasp_torques": 3}
    arrays = {name: np.zeros((count, *shape)) for name, shape in SHAPES.items()}
    arrays |= {name: np.zeros((count, limbs, size)) for name, size in each.items()}
    whole = {name: np.zeros(count, dtype=np.int64) for name in ("step", "phase", "contacts")}
    return Recording(**arrays, **whole)


def recording_of(plan, count=40):
    """A recording of `count` samples in which a plan goes from stance to stance in 50 s a step."""
    times = np.linspace(0.0, 50.0 * len(plan.steps), count)
    at = times / 50.0
    knots = np.arange(len(plan.stances))
    motion, limbs = plan.motion, plan.world.robot.limbs
    rng = np.random.default_rng(0)

    def between(values):
        flat = values.reshape(len(knots), -1)
        moved = [np.interp(at, knots, column) for column in flat.T]
        return np.stack(moved, axis=1).reshape(count, *values.shape[1:])

    return replace(
        resting(count, limbs),
        times=3.0 + times,
        step=np.minimum(at.astype(int), len(plan.steps) - 1),
        joint_positions=between(motion.joint_positions),
        joint_torques=rng.normal(size=(count, limbs, 6)),
        base_positions=between(motion.base_positions),
        base_quaternions=np.repeat(motion.base_quaternions[:1], count, axis=0),
        grasp_forces=rng.normal(size=(count, limbs, 3)),
    )
