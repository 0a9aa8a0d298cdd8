"""The joint controller: its law, its feedforward and the offset of its references."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from pinocchio_loads import loads_of
from pinocchio_robots import pinocchio_robot

from mlivr_gym import stance_graph
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.joint_controller import (
    DELAY_SHARE,
    Reference,
    _deflections,
    feedforward,
)
from mlivr_gym.simulation.parameters import (
    CONTROLLERS,
    PAPER,
    ControllerParameters,
    Limits,
    Physics,
)
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import step_trajectory

LIMITS = np.tile([150.0, 150.0, 150.0, 28.0, 28.0, 28.0], 2)
"""Largest torques of two UR5e, by the manufacturer [N m]."""


def reduction(robot, q, kd, limb, delay):
    """(I + T kd A)^-1 with the masses and Jacobians of Pinocchio, while one limb holds a point."""
    other, time = pinocchio_robot(robot), delay / DELAY_SHARE
    data, place = other.createData(), np.concatenate([[0, 0, 0, 0, 0, 0, 1.0], q])
    upper = np.triu(pin.crba(other, data, place))
    mass, frame = upper + np.triu(upper, 1).T, other.getFrameId(f"grasp{limb}")
    jacobian = pin.computeFrameJacobian(other, data, place, frame, pin.LOCAL_WORLD_ALIGNED)
    damping = np.repeat([Physics().grasp_damping, Physics().grasp_rotational_damping], 3)
    slowed = mass + time * jacobian.T @ (damping[:, None] * jacobian)
    return np.linalg.inv(np.eye(12) + time * kd[:, None] * np.linalg.inv(slowed)[6:, 6:])


@pytest.mark.parametrize("controller", [ControllerParameters(), ControllerParameters(delay=0.01)])
def test_joint_torques_are_those_of_the_control_law_within_the_manufacturers_limits(
    jem, plan, controller
):
    """The law is written out here with encoders that read up to 0.02 rad too much."""
    rng = np.random.default_rng(0)
    bias = DisturbanceRanges(encoder_bias=0.02).draw(7, 17, 2, len(jem))
    simulation = Simulation(jem, plan.world.robot, controller=controller, disturbance=bias)
    q, speed = rng.uniform(-1, 1, 12), rng.uniform(-1, 1, 12)
    model, data = simulation.model, simulation.data
    simulation.reset(np.array([4.0, 0, 0]), np.array([1.0, 0, 0, 0]), q.reshape(2, 6), [FREE, FREE])
    data.qvel[6:] = speed
    wanted = np.tile(q + rng.uniform(-0.1, 0.1, 12), (3, 1))
    wanted_speed, torque = rng.uniform(-1, 1, (3, 12)), rng.uniform(-5, 5, (3, 12))
    states, sensors = simulation._joint_controller.run(
        Reference(wanted, wanted_speed, torque), [False, True]
    )
    kp = np.concatenate([controller.kp_free, controller.kp_hold])
    kd = np.concatenate([controller.kd_free, controller.kd_hold])
    read = states[0, 8:20] + bias.encoder_bias.ravel()
    share = reduction(plan.world.robot, read, kd, 1, controller.delay)
    over = False
    for k in range(3):
        position, rate = states[k, 8:20], states[k, 1 + model.nq + 6 :]
        at = k if controller.delay == 0.0 else 0  # a known delay is longer than all three samples
        error = wanted[at] - position - bias.encoder_bias.ravel()
        asked = share @ (kp * error + kd * (wanted_speed[at] - rate)) + torque[k]
        names = [f"limb{i}/joint{j}" for i in range(2) for j in range(1, 7)]
        found = sensors[k, [model.sensor(name).adr[0] for name in names]]
        np.testing.assert_allclose(found, np.clip(asked, -LIMITS, LIMITS), atol=1e-9)
        over |= bool((np.abs(asked) > LIMITS).any())
    assert over


@pytest.mark.parametrize(("period", "delay"), [(0.002, 0.0), (0.006, 0.0), (0.002, 0.004)])
def test_torques_change_with_the_period_and_late_by_the_delay(jem, plan, period, delay):
    late = DisturbanceRanges(delay=delay).draw(1, 17, 2, len(jem))
    controller = replace(PAPER, period=period)
    simulation = Simulation(jem, plan.world.robot, controller=controller, disturbance=late)
    simulation.reset(*plan.configuration(0), [FREE, FREE])
    start = plan.motion.joint_positions[0].ravel()
    reference = Reference(*(np.tile(x, (12, 1)) for x in (start + 0.01, 0 * start, 0 * start)))
    states, sensors = simulation._joint_controller.run(reference, [False, False])
    address = simulation.model.sensor("limb0/joint2").adr[0]
    q, v = states[:, 9], states[:, 1 + simulation.model.nq + 7]
    asked = 100.0 * (start[1] + 0.01 - q) - 50.0 * v
    every, ticks = round(period / 0.002), round(delay / 0.002)
    read = np.maximum(np.arange(12) // every * every - ticks, 0)
    np.testing.assert_allclose(sensors[:, address], asked[read], atol=1e-9)
    assert len(set(read)) > 2


def test_the_controller_reads_late_with_bias_and_noise_as_large_as_stated(noisy):
    """Its torque, solved for the reading of the angles, and with their noise off of the speeds."""
    controller, count, late = noisy._joint_controller, 1500, 4
    ranges = noisy.disturbance.ranges
    start, none = noisy.data.qpos[7:].copy(), np.zeros((count, 12))
    reference, noise = Reference(np.tile(start, (count, 1)), none, none), {}
    noises = "encoder_noise", "speed_noise"
    for name in (*noises, ""):
        noisy.data.qpos[7:], noisy.data.qvel[:] = start, 0.0
        controller._ranges = replace(
            noisy.disturbance.ranges, **{each: 0.0 for each in noises if each != name}
        )
        controller.reset()
        states, sensors = controller.run(reference, [True, True])
        torques = sensors[late:, noisy._instruments._torques.ravel()]
        angles, speeds = states[:-late, 8:20], states[:-late, 26:]
        bias = noisy.disturbance.encoder_bias.ravel()
        pulled = 100.0 * (start - angles - bias) - 10.0 * speeds
        noise[name] = (pulled - torques) / (10.0 if name == "speed_noise" else 100.0)
        error = noise[name].std() / np.sqrt(len(torques)) + 1e-9
        assert np.abs(noise[name].mean(axis=0)).max() < 5.0 * error
    assert np.abs(speeds).max() > 0.01  # so that a reading of another time would not match
    assert np.abs(noise[""]).max() < 1e-9
    assert noise["encoder_noise"].std() == pytest.approx(ranges.encoder_noise, rel=0.02)
    assert noise["speed_noise"].std() == pytest.approx(ranges.speed_noise, rel=0.02)


@pytest.mark.parametrize("limbs", [2, 3, 4])
def test_limbs_that_hold_share_the_wrench_that_moves_the_base(jem, limbs):
    """Least squares of all wrenches: of N limbs N - 1 hold, and none bears it alone."""
    graph = stance_graph(jem, f"mlivr{limbs}")
    start, goal = sample_task(graph, np.random.default_rng(0), 0.5)
    plan = Planner(graph).plan(start.stance, goal, "steps").unwrap()
    walk = step_trajectory(graph, plan, 0, Limits(profile="quintic"), 0.01)
    torques, _ = feedforward(graph.robot, Physics(), walk)
    holding = np.flatnonzero(walk.grasps[1] != FREE).tolist()
    assert len(holding) == limbs - 1
    loads = loads_of(graph.robot, walk, holding)
    atol = 0.02 * np.abs(loads.torques).max()
    np.testing.assert_allclose(torques[1:-1], loads.torques, atol=atol)
    shares = np.linalg.norm(loads.wrenches[..., :3], axis=2).mean(axis=0)
    assert shares.min() > 0.1 * shares.mean()


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


def test_limbs_with_biased_encoders_do_not_work_against_each_other(jem):
    """Two limbs hold and one is free: no force comes up in the grasps within five seconds."""
    graph = stance_graph(jem, "mlivr3")
    start, goal = sample_task(graph, np.random.default_rng(0), 0.5)
    plan = Planner(graph).plan(start.stance, goal, "steps").unwrap()
    bias = DisturbanceRanges(encoder_bias=0.01).draw(2, 25, 3, len(jem))
    controller = CONTROLLERS["delayed"]
    simulation = Simulation(jem, graph.robot, controller=controller, disturbance=bias)
    points = [jem.index(point) for point in plan.stances[0]]
    simulation.reset(*plan.configuration(0), points)
    free = plan.steps[0].limb
    simulation._grippers.detach(free)
    simulation.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    control, joints = simulation._joint_controller, plan.configuration(0)[2].ravel()
    control.align_references(joints)
    still = np.zeros((250, 18))
    for _ in range(10):
        reference = Reference(np.tile(joints, (250, 1)), still, still)
        control.run(reference, [limb != free for limb in range(3)], recovering=True)
    mujoco.mj_forward(simulation.model, simulation.data)
    forces = [
        [simulation.data.sensor(f"limb{limb}/grasp/{axis}").data[0] for axis in "xyz"]
        for limb in range(3)
        if limb != free
    ]
    assert np.linalg.norm(forces, axis=1).max() < 2.0
