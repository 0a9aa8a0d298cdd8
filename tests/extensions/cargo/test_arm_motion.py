"""A limb that moves alone is as fast as each limit allows in turn, and no faster."""

from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from pinocchio_loads import loads_of

from mlivr_gym.extensions.cargo.arm_motion import LINE_SAMPLES, LimbMover, limb_trajectory
from mlivr_gym.extensions.cargo.cargo_mission import point_handle
from mlivr_gym.simulation.parameters import Limits

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


def test_each_line_to_a_point_ends_there_and_lies_along_its_normal(checked_graph, walk):
    """By Pinocchio; with the joint angles at the point given, those are its end."""
    position, quaternion, joints = walk.configuration(0)
    mover, found = LimbMover(checked_graph, 0, ()), 0
    mover.stand(position, quaternion, joints)
    free = pinocchio.JointModelFreeFlyer()
    model = pinocchio.buildModelFromXML(checked_graph.robot.to_urdf(), free)
    data, grasp_map = model.createData(), checked_graph.grasp_map
    tip = model.getFrameId("limb0/grasp")
    q = np.concatenate([position, np.roll(quaternion, -1), joints.ravel()])
    heights = np.linspace(checked_graph.robot.lift, 0.0, LINE_SAMPLES)
    for k in np.linalg.norm(grasp_map.positions - position, axis=1).argsort()[:60]:
        handle = point_handle(grasp_map, grasp_map.ids[k])
        for line in mover.reaches(handle):
            for height, angles in zip(heights, line, strict=True):
                q[7:13] = angles
                pinocchio.framesForwardKinematics(model, data, q)
                place = handle.point + height * handle.normal
                np.testing.assert_allclose(data.oMf[tip].translation, place, atol=1e-6)
            (again,) = mover.reaches(handle, line[-1])
            np.testing.assert_allclose(again, line, atol=1e-9)
            assert not mover.reaches(handle, line[-1] + 0.01)
            found += 1
    assert found > 10
