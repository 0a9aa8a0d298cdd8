"""What is measured of a simulated robot is there in its amount, and what disturbs it as well."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robots import pinocchio_robot
from recordings import resting
from scipy.spatial.transform import Rotation

from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.grippers import can_capture
from mlivr_gym.simulation.joint_controller import Reference
from mlivr_gym.simulation.parameters import ControllerParameters, Physics
from mlivr_gym.simulation.recording import Peaks
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import step_trajectory

RANGES = DisturbanceRanges(
    encoder_bias=0.02, encoder_noise=0.003, speed_noise=0.05, delay=0.008,
    sensor_position=0.004, sensor_angle=0.03,
)  # fmt: skip


@pytest.fixture
def simulation(jem, plan):
    """In the first stance of the plan, with gains of 100 N m/rad and 10 N m s/rad."""
    drawn, gains = RANGES.draw(3, 17, 2, len(jem)), ((100.0,) * 6, (10.0,) * 6) * 2
    simulation = Simulation(
        jem, plan.world.robot, controller=ControllerParameters(*gains), disturbance=drawn
    )
    points = [jem.index(point) for point in plan.stances[0]]
    simulation.reset(*plan.configuration(0), points)
    return simulation


def test_the_controller_reads_late_with_bias_and_noise_as_large_as_stated(simulation):
    """Its torque, solved for the reading of the angles, and with their noise off of the speeds."""
    controller, count, late = simulation._joint_controller, 1500, 4
    start, none = simulation.data.qpos[7:].copy(), np.zeros((count, 12))
    reference, noise = Reference(np.tile(start, (count, 1)), none, none), {}
    noises = "encoder_noise", "speed_noise"
    for name in (*noises, ""):
        simulation.data.qpos[7:], simulation.data.qvel[:] = start, 0.0
        controller._ranges = replace(RANGES, **{each: 0.0 for each in noises if each != name})
        controller.reset()
        states, sensors = controller.run(reference, [True, True])
        torques = sensors[late:, simulation._instruments._torques.ravel()]
        angles, speeds = states[:-late, 8:20], states[:-late, 26:]
        bias = simulation.disturbance.encoder_bias.ravel()
        pulled = 100.0 * (start - angles - bias) - 10.0 * speeds
        noise[name] = (pulled - torques) / (10.0 if name == "speed_noise" else 100.0)
        error = noise[name].std() / np.sqrt(len(torques)) + 1e-9
        assert np.abs(noise[name].mean(axis=0)).max() < 5.0 * error
    assert np.abs(speeds).max() > 0.01  # so that a reading of another time would not match
    assert np.abs(noise[""]).max() < 1e-9
    assert noise["encoder_noise"].std() == pytest.approx(RANGES.encoder_noise, rel=0.02)
    assert noise["speed_noise"].std() == pytest.approx(RANGES.speed_noise, rel=0.02)


def test_the_sensor_of_a_gripper_is_as_noisy_as_stated(simulation, checked_graph, plan):
    guidance, found = simulation._guidance, []
    trajectory = step_trajectory(checked_graph, plan, 0, Durations(), period=0.5)
    for _ in range(1500):
        guidance.start(plan.steps[0].limb, simulation.grasp_map.index(plan.steps[0].from_point))
        guidance.correct(trajectory, 0)
        found.append(guidance._filtered)
    found = np.array(found)
    assert found[:, :3].std() == pytest.approx(RANGES.sensor_position, rel=0.04)
    assert found[:, 3:].std() == pytest.approx(RANGES.sensor_angle, rel=0.04)
    guidance._noise = np.zeros(6)  # what is left is the error of the gripper alone
    guidance.start(plan.steps[0].limb, simulation.grasp_map.index(plan.steps[0].from_point))
    guidance.correct(trajectory, 0)
    middle = found.mean(axis=0) - guidance._filtered
    assert np.abs(middle / np.repeat([0.004, 0.03], 3)).max() < 5.0 / np.sqrt(1500)


@pytest.mark.parametrize(("distance", "angle"), [(0.99, 0.99), (1.01, 0.5), (0.5, 1.01)])
def test_a_gripper_captures_up_to_a_distance_and_an_angle(distance, angle):
    physics = Physics(capture_distance=0.02, capture_angle=0.05)
    assert can_capture(physics, 0.02 * distance, 0.05 * angle) == (max(distance, angle) < 1.0)


def test_the_error_of_a_gripper_is_its_distance_and_its_angle(simulation, plan):
    """The robot is moved as a whole, so that each gripper is off its point by as much."""
    data, grippers, held = simulation.data, simulation._grippers, simulation._grippers.points
    grippers._positions, grippers._turns = (
        simulation.grasp_map.positions.copy(), np.tile(np.eye(3), (len(simulation.grasp_map), 1, 1))
    )  # fmt: skip
    shift, turn = np.array([0.004, -0.003, 0.012]), Rotation.from_rotvec([0.01, 0.02, -0.02])
    place, angle = data.qpos[:3].copy(), Rotation.from_quat(data.qpos[3:7], scalar_first=True)
    for limb in range(2):
        pivot = simulation.grasp_map.positions[held[limb]]
        data.qpos[:3] = pivot + turn.apply(place - pivot) + shift
        data.qpos[3:7] = (turn * angle).as_quat(scalar_first=True)
        mujoco.mj_kinematics(simulation.model, data)
        assert grippers.error(limb, held[limb]) == pytest.approx((0.013, 0.03), abs=1e-5)


def test_momenta_and_errors_of_the_base_are_measured(simulation, checked_graph, plan):
    """Of random states: momenta against Pinocchio, errors by SciPy's rotations."""
    robot, model, data = plan.world.robot, simulation.model, simulation.data
    other, rng, count = pinocchio_robot(robot), np.random.default_rng(1), 5
    theirs, trajectory = other.createData(), step_trajectory(checked_graph, plan, 0)
    states, sensors, expected = [], [], []
    for k in range(count):
        turn = Rotation.random(None, rng)
        position, joints = rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 12)
        data.qpos[:] = [*position, *turn.as_quat(scalar_first=True), *joints]
        data.qvel[:] = rng.uniform(-1, 1, 18)
        mujoco.mj_forward(model, data)
        states.append([k * model.opt.timestep, *data.qpos, *data.qvel])
        sensors.append(data.sensordata.copy())
        speeds = [*turn.inv().apply(data.qvel[:3]), *data.qvel[3:]]
        q = np.array([*position, *turn.as_quat(), *joints])
        momentum = pin.computeCentroidalMomentum(other, theirs, q, np.array(speeds)).vector
        planned = Rotation.from_quat(trajectory.base_quaternions[k], scalar_first=True)
        away = np.linalg.norm(position - trajectory.base_positions[k])
        expected.append([*momentum, away, (planned.inv() * turn).magnitude()])
    found = simulation._instruments.measure(
        np.array(states), np.array(sensors), trajectory, 0, 0, 0
    ).recording
    measured = np.column_stack(
        [found.momenta, found.angular_momenta, found.base_errors, found.base_angle_errors]
    )
    np.testing.assert_allclose(measured, expected, atol=1e-5)


def test_peaks_are_the_largest_of_all_samples_and_of_all_parts():
    rng, parts = np.random.default_rng(0), []
    for _ in range(2):
        recording = replace(
            resting(30), joint_torques=-rng.uniform(size=(30, 2, 6)),
            grasp_forces=rng.normal(size=(30, 2, 3)), grasp_torques=rng.normal(size=(30, 2, 3)),
            base_errors=rng.uniform(size=30), base_angle_errors=rng.uniform(size=30),
        )  # fmt: skip
        parts.append((recording, -rng.uniform(size=(30, 2, 6))))
    found = Peaks.join([Peaks.of(*part) for part in parts])
    samples = [(recording, speeds, k) for recording, speeds in parts for k in range(30)]
    for limb in range(2):
        for name in ("grasp_force", "grasp_torque"):
            loads = [getattr(one, f"{name}s")[k, limb] for one, _, k in samples]
            largest = max(np.sqrt(load @ load) for load in loads)
            assert getattr(found, name)[limb] == pytest.approx(largest)
        for joint in range(6):
            torques = [abs(one.joint_torques[k, limb, joint]) for one, _, k in samples]
            assert found.joint_torque[limb, joint] == max(torques)
    means = [np.mean(one.joint_torques[k] ** 2) for one, _, k in samples]
    assert found.torque_rms == pytest.approx(np.sqrt(max(means)))
    assert found.joint_speed == max(np.abs(speeds[k]).max() for _, speeds, k in samples)
    assert found.base_error == max(one.base_errors[k] for one, _, k in samples)
    assert found.base_angle_error == max(one.base_angle_errors[k] for one, _, k in samples)


def test_the_module_feels_the_opposite_of_all_grasps(simulation):
    """Force, and torque about the origin, of random loads in the axes of random anchors."""
    rng, instruments = np.random.default_rng(6), simulation._instruments
    forces, torques = rng.normal(size=(2, 4, 2, 3))
    turns, places = Rotation.random(2, rng), rng.uniform(-3, 3, (2, 3))
    simulation.model.body_pos[instruments._anchors] = places
    simulation.model.body_quat[instruments._anchors] = turns.as_quat(scalar_first=True)
    found = instruments._on_module(forces, torques)
    for k in range(4):
        force, torque = np.zeros(3), np.zeros(3)
        for limb in range(2):
            pull = turns[limb].apply(forces[k, limb])
            force -= pull
            torque -= turns[limb].apply(torques[k, limb]) + np.cross(places[limb], pull)
        np.testing.assert_allclose(found["module_forces"][k], force)
        np.testing.assert_allclose(found["module_torques"][k], torque)
