"""Grasps, controller and steps in MuJoCo."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robots import pinocchio_robot
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from mlivr_gym.errors import PlanError, SimulationError
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.joint_controller import DELAY_SHARE, JointController, Reference
from mlivr_gym.simulation.parameters import (
    CONTROLLERS,
    PAPER,
    ControllerParameters,
    Limits,
    Physics,
)
from mlivr_gym.simulation.simulator import PathWatch, Simulation
from mlivr_gym.simulation.timing import step_trajectory


def hold_joints(simulation, plan):
    """Torques that keep the joints where the plan begins."""
    data = simulation.data
    error = plan.motion.joint_positions[0].ravel() - data.qpos[7:]
    data.ctrl[:12] = 100.0 * error - 10.0 * data.qvel[6:]


@pytest.mark.parametrize("axis", [1, 5])
def test_a_grasp_is_as_stiff_and_as_damped_as_asked(jem, plan, axis):
    """A force or torque on the gripper bends the grasp by force over stiffness.

    A moving gripper is braked by damping.
    """
    physics = Physics(grasp_stiffness=5e3, grasp_damping=900.0, grasp_rotational_stiffness=800.0)
    simulation = Simulation(jem, plan.world.robot, physics)
    points = [jem.index(point) for point in plan.stances[0]]
    simulation.reset(*plan.configuration(0), [FREE, points[1]])
    model, data = simulation.model, simulation.data
    # The gripper that holds nothing lies on its point and would touch what is behind.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    hold_joints(simulation, plan)
    site = data.site("limb1/grasp")
    frame, start = site.xmat.reshape(3, 3).copy(), site.xpos.copy()
    load = np.zeros(6)
    load[axis] = 4.0
    gripper = model.body("limb1/gripper").id
    for _ in range(5000):
        hold_joints(simulation, plan)
        data.qfrc_applied[:] = 0.0
        mujoco.mj_applyFT(
            model, data, frame @ load[:3], frame @ load[3:], site.xpos, gripper, data.qfrc_applied
        )
        mujoco.mj_step(model, data)
    moved = np.concatenate(
        [
            frame.T @ (site.xpos - start),
            Rotation.from_matrix(frame.T @ site.xmat.reshape(3, 3)).as_rotvec(),
        ]
    )
    stiffness = physics.grasp_stiffness if axis < 3 else physics.grasp_rotational_stiffness
    expected = load / stiffness
    np.testing.assert_allclose(moved, expected, atol=0.01 * abs(expected[axis]))
    simulation.reset(*plan.configuration(0), [FREE, points[1]])
    jacobian = np.zeros((6, model.nv))
    mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], model.site("limb1/grasp").id)
    data.qvel[:] = (
        np.linalg.pinv(jacobian) @ np.concatenate([frame @ load[:3], frame @ load[3:]]) * 0.01
    )
    mujoco.mj_forward(model, data)
    felt = [
        data.sensor(f"limb1/grasp/{name}").data[0]
        for name in ("x", "y", "z", "about_x", "about_y", "about_z")
    ]
    damping = physics.grasp_damping if axis < 3 else physics.grasp_rotational_damping
    np.testing.assert_allclose(felt, -damping * 0.01 * load, atol=1e-6)


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
    control = JointController(model, data, plan.world.robot, controller, bias, Physics())
    states, sensors = control.run(Reference(wanted, wanted_speed, torque), [False, True])
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
    control = JointController(
        simulation.model, simulation.data, plan.world.robot, controller, late, Physics()
    )
    states, sensors = control.run(reference, [False, False])
    address = simulation.model.sensor("limb0/joint2").adr[0]
    q, v = states[:, 9], states[:, 1 + simulation.model.nq + 7]
    asked = 100.0 * (start[1] + 0.01 - q) - 50.0 * v
    every, ticks = round(period / 0.002), round(delay / 0.002)
    read = np.maximum(np.arange(12) // every * every - ticks, 0)
    np.testing.assert_allclose(sensors[:, address], asked[read], atol=1e-9)
    assert len(set(read)) > 2


def test_the_grasp_gives_the_robot_its_momentum(checked_graph, plan, jem):
    """Newton: the impulse of the only grasp is the momentum gained.

    Up to an error that goes with the time step.
    """
    errors = []
    for timestep in (0.002, 0.0005):
        simulation = Simulation(
            jem, plan.world.robot, Physics(timestep=timestep), controller=CONTROLLERS["feedforward"]
        )
        recording = execute(
            checked_graph, plan, Limits(step_duration=10.0), simulation=simulation
        ).recording
        limb = 1 - plan.steps[0].limb
        tool = simulation.data.site(f"limb{limb}/anchor").xmat.reshape(3, 3)
        force = recording.grasp_forces[:, limb] @ tool.T
        impulse = cumulative_trapezoid(force, recording.times, axis=0, initial=0.0)
        gained = recording.momenta - recording.momenta[0]
        errors.append(np.abs(impulse - gained).max() / np.linalg.norm(gained, axis=1).max())
    assert errors[1] < 0.03
    assert errors[1] == pytest.approx(0.25 * errors[0], rel=0.1)


def test_a_step_is_carried_out_within_tolerance(walked, plan, jem):
    assert walked.failure is None
    assert walked.simulated_time == pytest.approx(52.0)
    (capture,) = walked.captures
    assert capture.distance < 1e-3
    assert capture.angle < 1e-3
    assert capture.point == plan.steps[0].to_point
    np.testing.assert_allclose(
        walked.recording.base_positions[-1], plan.motion.base_positions[1], atol=1e-3
    )
    assert walked.peaks.base_error < 5e-3
    assert walked.recording.contacts.max() == 0


def test_what_cannot_be_simulated_is_one_clear_error(checked_graph, plan, jem, simulation):
    start = plan.configuration(0)
    with pytest.raises(SimulationError, match="cannot hold it"):
        simulation.reset(*start, [jem.index("D5a:1"), jem.index("D1b:3")])
    simulation.reset(*start, [jem.index(point) for point in plan.stances[0]])
    with pytest.raises(SimulationError, match=r"time step is 0.002"):
        simulation.execute(step_trajectory(checked_graph, plan, 0, period=0.01))
    simulation.reset(*start, [FREE, FREE])
    with pytest.raises(SimulationError, match="the robot holds"):
        simulation.execute(step_trajectory(checked_graph, plan, 0))
    with pytest.raises(PlanError, match="no step"):
        execute(checked_graph, replace(plan, motion=replace(plan.motion, steps=())))


@pytest.mark.parametrize("share", [0.1, 0.8])
def test_a_limb_whose_path_is_blocked_holds_the_point_that_it_left(checked_graph, plan, jem, share):
    simulation = Simulation(jem, plan.world.robot, controller=ControllerParameters())
    points = [jem.index(point) for point in plan.stances[0]]
    simulation.reset(*plan.configuration(0), points)
    trajectory = step_trajectory(checked_graph, plan, 0, Durations(3.0, 9.0, 3.0))
    looks = []

    def is_blocked(followed, sample):
        assert followed is trajectory
        looks.append(sample)
        return sample >= share * len(trajectory.times)

    blocked = simulation.execute(trajectory, 3, PathWatch(0.5, is_blocked))
    assert (blocked.failure.kind, blocked.failure.step) == ("blocked path", 3)
    assert blocked.failure.message.endswith(f"{plan.steps[0].to_point!r}: its path is blocked")
    assert blocked.has_turned_back
    assert simulation.points == points
    assert blocked.peaks.grasp_force.max() < 60.0
    assert np.diff(blocked.recording.times).min() > 0.0
    spacing = round(0.5 / simulation.physics.timestep)
    assert max(np.diff(looks)) == spacing
    assert looks[-1] < share * len(trajectory.times) + spacing
    again = simulation.execute(trajectory)
    assert again.failure is None
    assert not again.has_turned_back
    assert simulation.points != points


def test_a_limb_that_is_nearly_there_does_not_turn_back(checked_graph, plan, jem):
    simulation = Simulation(jem, plan.world.robot, controller=ControllerParameters())
    simulation.reset(*plan.configuration(0), [jem.index(point) for point in plan.stances[0]])
    trajectory = step_trajectory(checked_graph, plan, 0, Durations(3.0, 9.0, 3.0))
    late = len(trajectory.times) - 100
    watch = PathWatch(0.05, lambda _, sample: sample >= late)
    assert simulation.execute(trajectory, watch=watch).failure is None


def test_the_summary_of_an_execution_is_that_of_its_samples_and_captures(walked):
    recording, told = walked.recording, walked.summary()
    momenta = [np.sqrt(momentum @ momentum) for momentum in recording.momenta]
    squares = [np.mean(torques**2) for torques in recording.joint_torques]
    assert told["largest_momentum_kg_m_s"] == pytest.approx(max(momenta))
    assert told["torque_rms_mean_N_m"] == pytest.approx(np.mean(np.sqrt(squares)))
    times = [0.0, *(one.time for one in walked.captures)]
    assert told["step_times_s"] == pytest.approx(np.diff(times))
    assert told["largest_capture_distance_m"] == max(one.distance for one in walked.captures)
    assert told["peaks"]["torque_rms"] >= np.sqrt(max(squares))
