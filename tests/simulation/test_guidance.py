"""What a reading of the sensor may change."""

import numpy as np
import pytest

from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.simulation.grippers import MAX_CHANGE
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import step_trajectory


def test_no_reading_changes_a_joint_by_more_than_it_may_either_way(checked_graph, jem, plan):
    """However far the gripper is off: the joint that would change most changes by just that.

    The robot stands where the step begins or ends, and is to be at other places of it.
    """
    simulation, step = Simulation(jem, plan.world.robot), plan.steps[0]
    trajectory = step_trajectory(checked_graph, plan, 0, Durations(), period=0.5)
    guidance, limb, ways = simulation._guidance, step.limb, set()
    for stance, at in ((0, -1), (1, 0)):
        points = [jem.index(point) for point in plan.stances[stance]]
        simulation.reset(*plan.configuration(stance), points)
        for k in (at, len(trajectory.times) // 2):
            guidance.start(limb, jem.index(step.to_point))
            before = simulation._joint_controller.offset.copy()
            guidance.correct(trajectory, k)
            change = (simulation._joint_controller.offset - before)[6 * limb : 6 * limb + 6]
            assert np.abs(change).max() == pytest.approx(MAX_CHANGE)
            ways.add(float(np.sign(change[np.abs(change).argmax()])))
    assert ways == {-1.0, 1.0}
