"""Torques that are fed forward, against Pinocchio's inverse dynamics."""

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robots import pinocchio_robot
from scipy.spatial.transform import Rotation

from mlivr_gym import stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.joint_controller import _deflections, feedforward
from mlivr_gym.simulation.parameters import Limits, Physics
from mlivr_gym.simulation.timing import step_trajectory


@pytest.mark.parametrize("limbs", [2, 3, 4])
def test_limbs_that_hold_share_the_wrench_that_moves_the_base(jem, limbs):
    """Least squares of all wrenches: of N limbs N - 1 hold, and none bears it alone."""
    graph = stance_graph(jem, f"mlivr{limbs}")
    start, goal = sample_task(graph, np.random.default_rng(0), 0.5)
    plan = Planner(graph).plan(start.stance, goal, "steps").unwrap()
    walk = step_trajectory(graph, plan, 0, Limits(), 0.002)
    torques, _ = feedforward(graph.robot, Physics(), walk)
    other = pinocchio_robot(graph.robot)
    other.gravity.linear[:] = 0.0
    data = other.createData()
    holding = np.flatnonzero(walk.grasps[1] != FREE)
    assert len(holding) == limbs - 1
    turns = Rotation.from_quat(walk.base_quaternions, scalar_first=True)
    times = walk.times

    def state(k, near):
        """Configuration and velocity in Pinocchio's order, from central differences."""
        q = [walk.base_positions[k], turns[k].as_quat(), walk.joint_positions[k].ravel()]
        span = times[k + near] - times[k - near]
        speed = (walk.base_positions[k + near] - walk.base_positions[k - near]) / span
        spin = (turns[k - near].inv() * turns[k + near]).as_rotvec() / span
        rates = (walk.joint_positions[k + near] - walk.joint_positions[k - near]).ravel() / span
        return np.concatenate(q), np.concatenate([turns[k].inv().apply(speed), spin, rates])

    def acceleration(k, near):
        """The same from central differences."""
        before, after = (state(n, near)[1] for n in (k - near, k + near))
        return (after - before) / (times[k + near] - times[k - near])

    shares = []
    for k in np.linspace(0.2, 0.8, 13) * len(times):
        k = int(k)
        (q, v), a = state(k, 2), acceleration(k, 2)
        if np.abs(a - acceleration(k, 1)).max() > 0.02 * np.abs(a).max() + 1e-4:
            continue  # a ramp of the acceleration begins or ends: differences do not tell it
        needed = pin.rnea(other, data, q, v, a)
        pin.computeJointJacobians(other, data, q)
        pin.updateFramePlacements(other, data)
        jacobian = np.concatenate(
            [
                pin.getFrameJacobian(
                    other, data, other.getFrameId(f"grasp{i}"), pin.LOCAL_WORLD_ALIGNED
                )
                for i in holding
            ]
        )
        wrench = np.linalg.lstsq(jacobian[:, :6].T, needed[:6], rcond=None)[0]
        expected = needed[6:] - jacobian[:, 6:].T @ wrench
        np.testing.assert_allclose(
            torques[k].ravel(), expected, atol=0.03 * np.abs(expected).max() + 0.01
        )
        shares.append(np.linalg.norm(wrench.reshape(-1, 6)[:, :3], axis=1))
    assert len(shares) >= 11
    assert np.mean(shares, axis=0).min() > 0.1 * np.mean(shares)


def test_a_grasp_that_is_loaded_bends_as_a_spring_beside_a_damper():
    """damping * x' + stiffness * x = -load - slope * t, from x = 0, in closed form."""
    physics = Physics(
        grasp_stiffness=5e3, grasp_damping=900.0,
        grasp_rotational_stiffness=800.0, grasp_rotational_damping=40.0,
    )  # fmt: skip
    period, loads = 0.05, np.array([[4.0, -2.0, 1.0, 0.5, 3.0, -1.0], [1, 2, 3, 4, 5, 6]])
    slopes = np.array([[0.0, 3.0, -1.0, 2.0, 0.0, 5.0], [6, 5, 4, 3, 2, 1]])
    stiffness, damping = np.repeat([5e3, 800.0], 3), np.repeat([900.0, 40.0], 3)
    times, constant = period * np.arange(40)[:, None, None], damping / stiffness
    rise = 1.0 - np.exp(-times / constant)
    expected = -(loads * rise + slopes * (times - constant * rise)) / stiffness
    found = _deflections(physics, loads + slopes * times, period)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
