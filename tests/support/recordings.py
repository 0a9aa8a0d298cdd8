"""Recordings of executions that never were."""

import numpy as np

from mlivr_gym.simulation.recording import Recording


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

    return Recording(
        times=3.0 + times,
        step=np.minimum(at.astype(int), len(plan.steps) - 1),
        phase=np.zeros(count, dtype=int),
        joint_positions=between(motion.joint_positions),
        joint_torques=rng.normal(size=(count, limbs, 6)),
        base_positions=between(motion.base_positions),
        base_quaternions=np.repeat(motion.base_quaternions[:1], count, axis=0),
        base_errors=np.zeros(count),
        base_angle_errors=np.zeros(count),
        grasp_forces=rng.normal(size=(count, limbs, 3)),
        grasp_torques=np.zeros((count, limbs, 3)),
        momenta=np.zeros((count, 3)),
        angular_momenta=np.zeros((count, 3)),
        contacts=np.zeros(count, dtype=int),
    )
