import argparse
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from plans import first_steps
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, Limb, Settings, robot_spec
from mlivr_gym.cli.main import main
from mlivr_gym.cli.simulate import add_arguments
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import PlanError, RobotError, SettingError, SimulationError
from mlivr_gym.motion.plan_motion import step_motion, step_trajectory
from mlivr_gym.motion.trajectory import FREE, Durations
from mlivr_gym.planners import Planner
from mlivr_gym.robot.specification import ur5e_data
from mlivr_gym.simulation.dynamics import Physics, dynamics_spec, torque_limits
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.failures import FailureWatch, Measured
from mlivr_gym.simulation.scene import set_configuration
from mlivr_gym.simulation.simulator import Simulation


@pytest.fixture(scope="module")
def plan(checked_graph):
    """One step of 0.4 m."""
    whole = Planner(checked_graph).plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()
    return first_steps(whole, 1)


@pytest.fixture(scope="module")
def simulation(jem, plan):
    return Simulation(jem, plan.world.robot)


@pytest.fixture(scope="module")
def walked(checked_graph, plan, simulation):
    """The step at the paper's 50 s."""
    return execute(checked_graph, plan, simulation=simulation)


@pytest.fixture
def floating(jem, plan):
    """A robot that holds nothing, controllers and grasps without effect, turning and bending."""
    simulation = Simulation(jem, plan.world.robot, Physics(timestep=0.001))
    model, data = simulation.model, simulation.data
    model.actuator_gainprm[:], model.actuator_biasprm[:] = 0.0, 0.0
    simulation.reset(
        np.array([4.0, 0.0, 0.0]),
        np.array([1.0, 0, 0, 0]),
        plan.motion.joint_positions[0],
        [FREE, FREE],
    )
    data.qvel[:] = np.random.default_rng(0).uniform(-0.2, 0.2, model.nv)
    return simulation


def pinocchio_robot(robot):
    """The robot from the manufacturer's joint origins and inertias, on a free flyer."""
    data, model = ur5e_data(), pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    size, mass = robot.body_size, robot.body_mass
    model.appendBodyToJoint(base, pin.Inertia.FromBox(mass, size, size, size), pin.SE3.Identity())
    for i in range(robot.limbs):
        place = pin.SE3(robot.mount_rotations[i], robot.mount_positions[i])
        parent = base
        for k, (origin, link) in enumerate(
            zip(data["urdf_joint_origins"], data["links"], strict=True)
        ):
            here = pin.SE3(
                pin.rpy.rpyToMatrix(*map(float, origin["rpy"])),
                np.array(origin["xyz"], dtype=float),
            )
            parent = model.addJoint(
                parent,
                pin.JointModelRZ(),
                place * here if k == 0 else here,
                f"limb{i}/joint{k + 1}",
            )
            inertia = pin.Inertia(
                link["mass"],
                np.array(link["com_urdf"], dtype=float),
                np.array(link["inertia_urdf"]),
            )
            model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        radius, length = data["gripper"]["radius"], robot.tool_length
        gripper = pin.Inertia.FromCylinder(robot.gripper_mass, radius, length)
        model.appendBodyToJoint(
            parent, gripper, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.5 * length]))
        )
        model.addFrame(
            pin.Frame(
                f"grasp{i}", parent, pin.SE3(np.eye(3), np.array([0.0, 0.0, length])), pin.OP_FRAME
            )
        )
    return model


@pytest.mark.parametrize("limbs", [2, 3])
def test_mass_matrix_and_kinematics_are_pinocchios(jem, limbs):
    robot = robot_spec(f"mlivr{limbs}")
    model, other = dynamics_spec(jem, robot).compile(), pinocchio_robot(robot)
    data, theirs, rng = mujoco.MjData(model), other.createData(), np.random.default_rng(limbs)
    order = [
        int(model.joint(f"limb{i}/joint{k}").dofadr[0]) for i in range(limbs) for k in range(1, 7)
    ]
    dofs = np.concatenate([np.arange(6), order])
    for _ in range(3):
        position, turn, joints = (
            rng.uniform(-1, 1, 3),
            Rotation.random(rng=rng),
            rng.uniform(-3, 3, (limbs, 6)),
        )
        set_configuration(model, data, position, turn.as_quat(scalar_first=True), joints)
        q = np.concatenate([position, turn.as_quat(), joints.ravel()])
        pin.crba(other, theirs, q)
        mass = np.triu(theirs.M) + np.triu(theirs.M, 1).T
        # MuJoCo's linear velocity of the base is in world axes, Pinocchio's in the base's.
        axes = np.eye(model.nv)
        axes[:3, :3] = turn.as_matrix().T
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        np.testing.assert_allclose(full[np.ix_(dofs, dofs)], axes.T @ mass @ axes, atol=2e-6)
        pin.framesForwardKinematics(other, theirs, q)
        for i in range(limbs):
            frame = theirs.oMf[other.getFrameId(f"grasp{i}")]
            np.testing.assert_allclose(
                data.site(f"limb{i}/grasp").xpos, frame.translation, atol=1e-9
            )
            np.testing.assert_allclose(
                data.site(f"limb{i}/grasp").xmat.reshape(3, 3), frame.rotation, atol=1e-9
            )


def momenta(simulation):
    mujoco.mj_forward(simulation.model, simulation.data)
    linear = simulation.mass * simulation.data.sensor("velocity").data
    centre = simulation.data.subtree_com[simulation.model.body("base").id]
    return linear.copy(), simulation.data.sensor("angular_momentum").data + np.cross(centre, linear)


def test_momentum_is_kept_when_nothing_is_held_and_nothing_pulls(floating):
    linear, angular = momenta(floating)
    for _ in range(1000):
        mujoco.mj_step(floating.model, floating.data)
    assert floating.data.ncon == 0
    after = momenta(floating)
    np.testing.assert_allclose(after[0], linear, atol=2e-3 * np.linalg.norm(linear))
    np.testing.assert_allclose(after[1], angular, atol=5e-3 * np.linalg.norm(angular))


def test_energy_falls_under_damping_alone(floating):
    model, data = floating.model, floating.data
    model.actuator_biasprm[floating.joint_actuators, 2] = -50.0
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    energies = []
    for _ in range(300):
        mujoco.mj_step(model, data)
        energies.append(data.energy[1])
    assert (np.diff(energies) < 0.0).all()


@pytest.mark.parametrize("axis", range(6))
def test_a_grasp_is_as_stiff_and_as_damped_as_asked(jem, plan, axis):
    """A force or torque on the gripper bends the grasp by force over stiffness.

    A moving gripper is braked by damping.
    """
    physics = Physics(grasp_stiffness=5e3, grasp_damping=900.0, grasp_rotational_stiffness=800.0)
    simulation = Simulation(jem, plan.world.robot, physics)
    points = [jem.index(point) for point in plan.stances[0]]
    simulation.reset(
        *plan.configuration(0), [FREE, points[1]],
    )  # fmt: skip
    model, data = simulation.model, simulation.data
    # The gripper that holds nothing lies on its point and would touch what is behind.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data.ctrl[simulation.joint_actuators] = plan.motion.joint_positions[0].ravel()
    site = data.site("limb1/grasp")
    frame, start = site.xmat.reshape(3, 3).copy(), site.xpos.copy()
    load = np.zeros(6)
    load[axis] = 4.0
    gripper = model.body("limb1/gripper").id
    for _ in range(5000):
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
    simulation.reset(
        plan.motion.base_positions[0],
        plan.motion.base_quaternions[0],
        plan.motion.joint_positions[0],
        [FREE, points[1]],
    )
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


def test_joint_torques_are_those_of_the_pd_law_within_the_manufacturers_limits(jem, plan):
    simulation = Simulation(jem, plan.world.robot)
    rng, data = np.random.default_rng(0), simulation.data
    q, speed = rng.uniform(-1, 1, 12), rng.uniform(-1, 1, 12)
    wanted, wanted_speed = q + rng.uniform(-2, 2, 12), rng.uniform(-1, 1, 12)
    simulation.reset(np.array([4.0, 0, 0]), np.array([1.0, 0, 0, 0]), q.reshape(2, 6), [FREE, FREE])
    data.qvel[6:] = speed
    data.ctrl[simulation.joint_actuators] = wanted + 0.5 * wanted_speed
    mujoco.mj_forward(simulation.model, data)
    asked = 100.0 * (wanted - q) + 50.0 * (wanted_speed - speed)
    limits = np.tile([150.0, 150.0, 150.0, 28.0, 28.0, 28.0], 2)
    found = [data.sensor(f"limb{i}/joint{k}").data[0] for i in range(2) for k in range(1, 7)]
    assert (np.abs(asked) > limits).any()
    np.testing.assert_allclose(found, np.clip(asked, -limits, limits), atol=1e-9)
    np.testing.assert_allclose(torque_limits(), limits[:6])


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


def test_feedforward_tracks_better_than_the_papers_controller(checked_graph, plan, walked):
    plain = execute(checked_graph, plan, physics=Physics(feedforward=False))
    assert plain.failure is None
    assert plain.captures[0].distance < plain.physics.capture_distance
    assert walked.peaks.base_error < 0.2 * plain.peaks.base_error


def test_the_grasp_gives_the_robot_its_momentum(checked_graph, plan, jem):
    """Newton: the impulse of the only grasp is the momentum gained.

    Up to an error that goes with the time step.
    """
    errors = []
    for timestep in (0.002, 0.0005):
        simulation = Simulation(jem, plan.world.robot, Physics(timestep=timestep))
        recording = execute(
            checked_graph, plan, Durations.of_step(20.0), simulation=simulation
        ).recording
        limb = 1 - plan.steps[0].limb
        tool = simulation.data.site(f"limb{limb}/anchor").xmat.reshape(3, 3)
        force = recording.grasp_forces[:, limb] @ tool.T
        impulse = cumulative_trapezoid(force, recording.times, axis=0, initial=0.0)
        gained = recording.momenta - recording.momenta[0]
        errors.append(np.abs(impulse - gained).max() / np.linalg.norm(gained, axis=1).max())
    assert errors[1] < 0.03
    assert errors[1] == pytest.approx(0.25 * errors[0], rel=0.1)


def test_measurements_are_saved(walked, tmp_path):
    walked.save(tmp_path / "walk.npz")
    with np.load(tmp_path / "walk.npz") as data:
        torques = data["joint_torques"]
        assert torques.shape == (2600, 2, 6)
        assert data["phase"].max() == 2
    np.testing.assert_allclose(walked.recording.torque_rms**2 * 12, (torques**2).sum(axis=(1, 2)))
    assert walked.peaks.torque_rms >= walked.recording.torque_rms.max() > 0.0
    assert '"success": true' in (tmp_path / "walk.json").read_text()


def failed(graph, plan, **changes):
    execution = execute(
        graph, plan, Durations.of_step(changes.pop("duration", 50.0)), Physics(**changes)
    )
    failure = execution.failure
    assert failure is not None
    assert failure.step == 0
    assert failure.time <= execution.durations.total
    assert not execution.captures
    assert execution.simulated_time == failure.time
    return failure


def test_a_grasp_that_misses_is_a_failure_with_its_numbers(checked_graph, plan):
    failure = failed(checked_graph, plan, capture_distance=1e-9, duration=10.0)
    assert failure.kind == "missed grasp"
    assert failure.limb == plan.steps[0].limb
    assert failure.phase == "approach"
    assert failure.values["distance_m"] > failure.values["allowed_distance_m"] == 1e-9


def test_a_lost_hold_and_a_limb_at_its_torque_limit_are_failures(checked_graph, plan):
    failure = failed(checked_graph, plan, hold_force=0.1)
    assert failure.kind == "lost hold"
    assert failure.limb == 1 - plan.steps[0].limb
    assert 0.1 < failure.values["force_N"] < 0.12
    failure = failed(
        checked_graph, plan, duration=1.5, hold_force=1e4, hold_torque=1e4, saturation_time=0.02
    )
    assert failure.kind == "saturation"
    assert abs(failure.values["torque_N_m"]) in (28.0, 150.0)


@pytest.mark.parametrize("name", ["tool bag", "limbo", "body"])
def test_a_collision_is_a_failure_that_names_what_touches(checked_graph, plan, jem, name):
    step, motion = plan.steps[0], step_motion(checked_graph, plan, 0, 41)
    swinging = np.flatnonzero(motion.phase == 1)
    k = int(swinging[len(swinging) // 2])
    robot = Simulation(jem, plan.world.robot)
    robot.reset(
        motion.base_positions[k],
        motion.base_quaternions[k],
        motion.joint_positions[k],
        [FREE, FREE],
    )
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
    """The damping of joints as light as a wrist's is too stiff for an explicit integrator."""
    monkeypatch.chdir(tmp_path)  # MuJoCo leaves a log file
    simulation = Simulation(jem, plan.world.robot, Physics(hold_force=1e9, hold_torque=1e9))
    simulation.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    failure = execute(checked_graph, plan, simulation=simulation).failure
    assert failure is not None
    assert failure.kind == "divergence"


UR10E = Limb(d1=0.1807, a2=-0.6127, a3=-0.57155, d4=0.17415, d5=0.11985, d6=0.11655)
"""Lengths published by the manufacturer; its links weigh 32 kg and not the UR5e's 18 kg."""


def test_another_arm_is_not_simulated_with_masses_of_the_ur5e(
    jem, checked_graph, plan, tmp_path, capsys
):  # fmt: skip
    robot = replace(plan.world.robot, name="ur10e", limb=UR10E)
    told = r"'ur10e'.*a2 -0\.6127 m \(UR5e -0\.425 m\).*assume_ur5e_masses"
    refused = pytest.raises(RobotError, match=told)
    with refused:
        execute(checked_graph, replace(plan, world=replace(plan.world, robot=robot)))
    with refused:
        dynamics_spec(jem, robot)
    with refused:
        MlivrEnv(robot, dynamics="mujoco", collisions=False)
    path, out = tmp_path / "plan.json", tmp_path / "walk"
    world = replace(plan.world, robot=robot, settings=Settings(collisions=False))
    replace(plan, world=world).save(path)
    assert main(["simulate", "--plan", str(path), "--out", str(out)]) == 2
    assert "robot 'ur10e' cannot be simulated" in capsys.readouterr().err
    assert not out.exists()


def test_another_arm_is_simulated_where_that_is_asked_for(jem):
    robot = replace(robot_spec("mlivr2"), name="ur10e", limb=UR10E)
    simulation = Simulation(jem, robot, Physics(assume_ur5e_masses=True))
    assert simulation.mass == pytest.approx(20.0 + 2 * (17.70 + 0.5))
    how = {"dynamics": "mujoco", "collisions": False, "physics": Physics(assume_ur5e_masses=True)}
    MlivrEnv(robot, **how).reset(seed=0)
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    assert parser.parse_args(["--assume-ur5e-masses"]).assume_ur5e_masses
    assert not parser.parse_args([]).assume_ur5e_masses


@pytest.mark.parametrize(
    "changes",
    [
        {"limbs": 4, "body_mass": 8.0, "body_size": 0.3, "tool_length": 0.08, "mount_radius": 0.15},
        {"limb": Limb(joint_limits=((-3.0, 3.0),) * 6)},
        {"limb": Limb(a2=-0.42512, a3=-0.39198)},  # as calibrated
    ],
)
def test_robots_with_limbs_of_the_ur5e_are_simulated(jem, changes):
    robot = replace(robot_spec("mlivr2"), name="own", **changes)
    mass = robot.body_mass + robot.limbs * (17.70 + robot.gripper_mass)
    assert Simulation(jem, robot).mass == pytest.approx(mass)


def measured(count, **changes):
    zero = {
        "times": 0.002 * np.arange(count), "joints": np.zeros((count, 2, 6)),
        "speeds": np.zeros((count, 2, 6)),
        "torques": np.zeros((count, 2, 6)), "base": np.zeros((count, 7)),
        "base_errors": np.zeros(count),
        "base_angle_errors": np.zeros(count), "forces": np.zeros((count, 2, 3)),
        "grasp_torques": np.zeros((count, 2, 3)),
        "velocity": np.zeros((count, 3)), "angular_momentum": np.zeros((count, 3)),
        "contacts": np.zeros(count, dtype=np.int64), "finite": np.ones(count, dtype=bool),
    }  # fmt: skip
    return Measured(**{**zero, **changes})


def test_the_first_failure_is_found_also_across_chunks():
    limits = np.tile([-2 * np.pi, 2 * np.pi], (6, 1))
    watch = FailureWatch(Physics(saturation_time=0.02), limits, 4)
    assert watch.first(measured(50), "swing", [True, True]) is None
    torques = np.zeros((50, 2, 6))
    torques[43:, 1, 4] = -28.0
    assert watch.first(measured(50, torques=torques), "swing", [True, True]) is None
    torques = np.zeros((50, 2, 6))
    torques[:20, 1, 4] = -28.0
    index, failure = watch.first(measured(50, torques=torques), "swing", [True, True])
    # Seven time steps at the end of the last chunk and four here make more than 0.02 s.
    assert (index, failure.kind, failure.limb, failure.step) == (3, "saturation", 1, 4)
    joints = np.zeros((50, 2, 6))
    joints[30:, 0, 2] = 2 * np.pi + 0.1
    index, failure = watch.first(measured(50, joints=joints), "approach", [True, True])
    assert (index, failure.kind, failure.limb) == (30, "joint limit", 0)
    assert failure.values["joint"] == 3.0
    finite = np.arange(50) < 10
    index, failure = watch.first(
        measured(50, finite=finite, joints=joints), "approach", [True, True]
    )
    assert (index, failure.kind) == (10, "divergence")


def test_what_cannot_be_simulated_is_one_clear_error(checked_graph, plan, jem, simulation):
    with pytest.raises(SettingError, match="kp is -1"):
        Physics(kp=-1.0)
    start = (
        plan.motion.base_positions[0],
        plan.motion.base_quaternions[0],
        plan.motion.joint_positions[0],
    )
    with pytest.raises(SimulationError, match="cannot hold it"):
        simulation.reset(*start, [jem.index("D5a:1"), jem.index("D1b:3")])
    simulation.reset(*start, [jem.index(point) for point in plan.stances[0]])
    with pytest.raises(SimulationError, match=r"time step is 0.002"):
        simulation.execute(step_trajectory(checked_graph, plan, 0, period=0.01))
    simulation.reset(*start, [FREE, FREE])
    with pytest.raises(SimulationError, match="the robot holds"):
        simulation.execute(step_trajectory(checked_graph, plan, 0, Durations.of_step(5.0)))
    with pytest.raises(PlanError, match="no step"):
        execute(checked_graph, replace(plan, motion=replace(plan.motion, steps=())))
