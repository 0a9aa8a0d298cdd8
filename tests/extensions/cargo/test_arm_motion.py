"""A limb that moves alone is as fast as each limit allows in turn, and no faster."""

from dataclasses import replace

import numpy as np
import pytest
from pinocchio_loads import loads_of

from mlivr_gym.extensions.cargo.arm_motion import limb_trajectory
from mlivr_gym.simulation.limits import Limits

LOOSE = Limits(1.0, 1.0, 1e5, 1e5)


@pytest.mark.parametrize(
    ("name", "value"),
    [("torque", 0.05), ("speed", 0.2), ("grasp_force", 2.0), ("grasp_torque", 2.0)],
)
def test_each_line_reaches_the_limit_that_decides(checked_graph, walk, name, value):
    """By Pinocchio, from positions alone, on two lines of different length."""
    limits, robot = replace(LOOSE, **{name: value}), checked_graph.robot
    position, quaternion, joints = walk.configuration(0)
    bends = np.array([[0.3, -0.2, 0.4, 0.1, -0.3, 0.2], [-0.2, 0.5, 0.1, 0.9, 0.3, -0.2]])
    knots = joints[0] + np.cumsum([np.zeros(6), *bends], axis=0)
    points = -1, checked_graph.grasp_map.index(walk.stances[0][1])
    start = position, quaternion, joints, points
    way = limb_trajectory(checked_graph, 0, knots, start, robot, limits)
    loads = loads_of(robot, way, [1])
    force, torque = (np.linalg.norm(loads.wrenches[..., k : k + 3], axis=2) for k in (0, 3))
    shares = {
        "torque": (np.abs(loads.torques) / robot.torque_limits / limits.torque).reshape(-1, 12),
        "speed": (np.abs(loads.speeds) / robot.speed_limits / limits.speed).reshape(-1, 12),
        "grasp_force": force / limits.grasp_force,
        "grasp_torque": torque / limits.grasp_torque,
    }
    middle = int(np.abs(way.joint_positions[:, 0] - knots[1]).sum(axis=1).argmin())
    for line in (slice(0, middle - 1), slice(middle - 1, None)):
        largest = {key: float(each[line].max()) for key, each in shares.items()}
        assert largest.pop(name) == pytest.approx(1.0, abs=0.01)
        assert max(largest.values()) < 1.0
