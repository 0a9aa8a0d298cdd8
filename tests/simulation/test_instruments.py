"""What is measured of a simulated robot, and what ends a walk."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robots import pinocchio_robot
from recordings import resting
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, Limb
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.robot.specification import MLIVR2
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.instruments import FailureMonitor
from mlivr_gym.simulation.parameters import Physics
from mlivr_gym.simulation.recording import Peaks
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import step_trajectory


def test_momenta_and_errors_of_the_base_are_measured(noisy, checked_graph, plan):
    """Of random states: momenta against Pinocchio, errors by SciPy's rotations."""
    robot, model, data = plan.world.robot, noisy.model, noisy.data
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
    found = noisy._instruments.measure(np.array(states), np.array(sensors), trajectory, 0, 0, 0)[0]
    measured = np.column_stack(
        [found.momenta, found.angular_momenta, found.base_errors, found.base_angle_errors]
    )
    np.testing.assert_allclose(measured, expected, atol=1e-5)


def test_the_module_feels_the_opposite_of_all_grasps(noisy):
    """Force, and torque about the origin, of random loads in the axes of random anchors."""
    rng, instruments = np.random.default_rng(6), noisy._instruments
    forces, torques = rng.normal(size=(2, 4, 2, 3))
    turns, places = Rotation.random(2, rng), rng.uniform(-3, 3, (2, 3))
    noisy.model.body_pos[instruments._anchors] = places
    noisy.model.body_quat[instruments._anchors] = turns.as_quat(scalar_first=True)
    found = instruments._on_module(forces, torques)
    for k in range(4):
        force, torque = np.zeros(3), np.zeros(3)
        for limb in range(2):
            pull = turns[limb].apply(forces[k, limb])
            force -= pull
            torque -= turns[limb].apply(torques[k, limb]) + np.cross(places[limb], pull)
        np.testing.assert_allclose(found["module_forces"][k], force)
        np.testing.assert_allclose(found["module_torques"][k], torque)


def test_peaks_are_the_largest_of_all_samples_and_of_all_parts():
    rng, parts = np.random.default_rng(0), []
    for _ in range(2):
        recording = replace(
            resting(30), joint_torques=-rng.uniform(size=(30, 2, 6)),
            grasp_forces=rng.normal(size=(30, 2, 3)), grasp_torques=rng.normal(size=(30, 2, 3)),
            base_errors=rng.uniform(size=30), base_angle_errors=rng.uniform(size=30),
        )  # fmt: skip
        parts.append(recording)
    found = Peaks.join([Peaks.of(part) for part in parts])
    samples = [(recording, k) for recording in parts for k in range(30)]
    for limb in range(2):
        for name in ("grasp_force", "grasp_torque"):
            loads = [getattr(one, f"{name}s")[k, limb] for one, k in samples]
            largest = max(np.sqrt(load @ load) for load in loads)
            assert getattr(found, name)[limb] == pytest.approx(largest)
        for joint in range(6):
            torques = [abs(one.joint_torques[k, limb, joint]) for one, k in samples]
            assert found.joint_torque[limb, joint] == max(torques)
    means = [np.mean(one.joint_torques[k] ** 2) for one, k in samples]
    assert found.torque_rms == pytest.approx(np.sqrt(max(means)))
    assert found.base_error == max(one.base_errors[k] for one, k in samples)
    assert found.base_angle_error == max(one.base_angle_errors[k] for one, k in samples)


@pytest.mark.parametrize("name", ["tool bag", "limbo", "body"])
def test_a_collision_is_a_failure_that_names_what_touches(checked_graph, plan, jem, name):
    step, motion = plan.steps[0], plan.joint_path(0).samples(41)
    swinging = np.flatnonzero(motion.phase == 1)
    k = int(swinging[len(swinging) // 2])
    robot = Simulation(jem, plan.world.robot)
    here = motion.base_positions[k], motion.base_quaternions[k], motion.joint_positions[k]
    robot.reset(*here, [FREE, FREE])
    place = robot.data.site(f"limb{step.limb}/grasp").xpos
    box = Box.between(name, "obstacle", place - 0.05, place + 0.05)
    failure = execute(
        checked_graph, replace(plan, world=replace(plan.world, obstacles=(box,)))
    ).failure
    assert failure is not None
    assert failure.kind == "collision"
    assert failure.limb == step.limb
    assert f"box/{name} " in failure.message
    assert failure.values["depth_m"] > 0.0


def test_divergence_is_a_failure(checked_graph, plan, jem, tmp_path, monkeypatch):
    """The damping of a grasp is too stiff for an explicit integrator."""
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a log file
    simulation = Simulation(
        jem, plan.world.robot, Physics(hold_force=1e9, hold_torque=1e9, joint_limit_tolerance=1e11)
    )
    simulation.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    simulation.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    failure = execute(checked_graph, plan, simulation=simulation).failure
    assert failure is not None
    assert failure.kind == "divergence"


def measured(count, finite=None, **changes):
    """What some time steps of a robot of two limbs measure that rests, but for some changes."""
    recording = replace(resting(count), times=0.002 * np.arange(count), **changes)
    return recording, np.ones(count, dtype=bool) if finite is None else finite


def test_the_first_failure_is_found_also_across_chunks():
    monitor = FailureMonitor(Physics(saturation_time=0.02), MLIVR2)
    assert monitor.first_failure(*measured(50)) is None
    torques = np.zeros((50, 2, 6))
    torques[43:, 1, 4] = -28.0
    assert monitor.first_failure(*measured(50, joint_torques=torques)) is None
    torques = np.zeros((50, 2, 6))
    torques[:20, 1, 4] = -28.0
    where = {"step": np.full(50, 4), "phase": np.full(50, 1)}
    index, failure = monitor.first_failure(*measured(50, joint_torques=torques, **where))
    # Seven time steps at the end of the last chunk and four here make more than 0.02 s.
    assert (index, failure.kind, failure.limb) == (3, "saturation", 1)
    assert (failure.step, failure.phase) == (4, "swing")
    joints = np.zeros((50, 2, 6))
    joints[30:, 0, 2] = 2 * np.pi + 0.1
    index, failure = monitor.first_failure(*measured(50, joint_positions=joints))
    assert (index, failure.kind, failure.limb) == (30, "joint limit", 0)
    assert failure.values["joint"] == 3.0
    finite = np.arange(50) < 10
    index, failure = monitor.first_failure(*measured(50, finite=finite, joint_positions=joints))
    assert (index, failure.kind) == (10, "divergence")


@pytest.mark.parametrize(("sign", "limb", "joint"), [(1.0, 0, 5), (-1.0, 1, 2)])
def test_both_limits_of_every_joint_are_watched(sign, limb, joint):
    """Beyond the margin of 3 degrees, and not within it."""
    robot = replace(MLIVR2, limb=Limb(joint_limits=((-1.0, 2.0),) * 6))
    edge = 2.0 if sign > 0.0 else -1.0
    for beyond, fails in ((np.deg2rad(2.9), False), (np.deg2rad(3.1), True)):
        joints = np.zeros((20, 2, 6))
        joints[7:, limb, joint] = edge + sign * beyond
        found = FailureMonitor(Physics(), robot).first_failure(
            *measured(20, joint_positions=joints)
        )
        assert (found is not None) == fails
    index, failure = found
    assert (index, failure.kind, failure.limb) == (7, "joint limit", limb)
    assert failure.values == {"joint": joint + 1.0, "angle_rad": joints[7, limb, joint]}


@pytest.mark.parametrize("limb", [0, 1])
@pytest.mark.parametrize(
    ("name", "most", "key"),
    [("grasp_forces", 200.0, "force_N"), ("grasp_torques", 100.0, "torque_N_m")],
)
def test_a_hold_is_lost_above_its_force_and_above_its_torque(limb, name, most, key):
    """By the length of the vector."""
    for size in (0.99, 1.01):
        wrench = np.zeros((20, 2, 3))
        wrench[4:, limb] = size * most * np.array([2.0, -1.0, 2.0]) / 3.0
        given = measured(20, **{name: wrench})
        found = FailureMonitor(Physics(), MLIVR2).first_failure(*given)
        assert (found is not None) == (size > 1.0)
    index, failure = found
    assert (index, failure.kind, failure.limb) == (4, "lost hold", limb)
    assert failure.values[key] == pytest.approx(1.01 * most)
    assert failure.values[f"allowed_{key}"] == most
