"""Torques, wrenches and compatible motions against Pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robots import pinocchio_robot
from scipy.linalg import null_space, orth
from scipy.spatial.transform import Rotation

from mlivr_gym import robot_spec
from mlivr_gym.simulation.inverse_dynamics import compatible_motions, compute_inverse_dynamics


@pytest.mark.parametrize(("limbs", "holding"), [(2, (0,)), (2, (1,)), (3, (0, 2)), (4, (1, 2, 3))])
def test_torques_and_wrenches_are_pinocchios(limbs, holding):
    """Of any motion, whether or not grasps allow it; several share the wrench by least squares."""
    robot, rng, count = robot_spec(f"mlivr{limbs}"), np.random.default_rng(limbs), 5
    model = pinocchio_robot(robot)
    model.gravity.linear[:] = 0.0
    data = model.createData()
    turns = Rotation.random(count, rng)
    places, joints = rng.uniform(-1, 1, (count, 3)), rng.uniform(-3, 3, (count, 6 * limbs))
    speeds, changes = rng.uniform(-1, 1, (2, 1, count, 6 + 6 * limbs))
    positions = np.column_stack([places, turns.as_quat(scalar_first=True), joints])
    found = compute_inverse_dynamics(robot, holding, positions, speeds, changes)
    for k in range(count):
        q = np.concatenate([places[k], turns[k].as_quat(), joints[k]])
        back, v, a = turns[k].inv(), speeds[0, k].copy(), changes[0, k].copy()
        v[:3] = back.apply(v[:3])
        a[:3] = back.apply(a[:3]) - np.cross(v[3:6], v[:3])  # Pinocchio's axes turn with the base
        needed = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        frames = [model.getFrameId(f"grasp{i}") for i in holding]
        jacobian = np.concatenate(
            [pin.getFrameJacobian(model, data, one, pin.LOCAL_WORLD_ALIGNED) for one in frames]
        )
        wrench = np.linalg.lstsq(jacobian[:, :6].T, needed[:6], rcond=None)[0]
        torques = needed[6:] - jacobian[:, 6:].T @ wrench
        np.testing.assert_allclose(found.wrenches[0, k].ravel(), wrench, atol=1e-5)
        np.testing.assert_allclose(found.torques[0, k].ravel(), torques, atol=1e-5)


@pytest.mark.parametrize("holding", [[1], [0, 2], [0, 1, 2]])
def test_compatible_motions_are_those_that_leave_the_grippers_where_they_are(holding):
    """The null space of Pinocchio's Jacobians of all grippers that hold, without its base."""
    robot, joints = robot_spec("mlivr3"), np.random.default_rng(3).uniform(-2.0, 2.0, 18)
    other = pinocchio_robot(robot)
    data, place = other.createData(), np.concatenate([[0, 0, 0, 0, 0, 0, 1.0], joints])
    jacobians = [
        pin.computeFrameJacobian(other, data, place, other.getFrameId(f"grasp{i}"), pin.LOCAL)
        for i in holding
    ]
    motions = orth(null_space(np.concatenate(jacobians))[6:])
    found = compatible_motions(robot, holding, joints)
    np.testing.assert_allclose(found, motions @ motions.T, atol=1e-9)
