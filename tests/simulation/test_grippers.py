"""Grasps, what grippers may touch, and the sensor that guides them."""

import mujoco
import numpy as np
import pytest
from coal_ruler import behind
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, robot_spec
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.trajectory import FREE
from mlivr_gym.simulation.dynamics import gripper_bit
from mlivr_gym.simulation.grippers import MAX_CHANGE
from mlivr_gym.simulation.parameters import (
    Physics,
)
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import step_trajectory
from mlivr_gym.world.boxes import BOX, scene_name


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


def boxes_about(points, normals, rng):
    """Turned boxes whose tops are flush with the surface of a point, below it, above it."""
    boxes = []
    for k, (point, normal) in enumerate(zip(points, normals, strict=True)):
        turn, half = Rotation.random(None, rng).as_matrix(), rng.uniform(0.01, 0.2, 3)
        top = np.abs(normal @ turn) @ half
        out = (1.9e-3, 2.1e-3, -0.1, 0.1)[k % 4]
        aside = np.cross(normal, rng.normal(size=3)) * 0.1
        centre = point + aside + (out - top) * normal
        boxes.append(Box(f"near{k}", "obstacle", tuple(centre), tuple(half), Box.rows(turn)))
    return boxes


@pytest.mark.parametrize("limb", [0, 1])
def test_a_gripper_meets_every_box_but_those_of_which_no_corner_stands_out(jem, limb):
    """Out of the surface of a point; what the other gripper meets stays."""
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(jem), 12, replace=False)
    near = boxes_about(jem.positions[chosen], jem.normals[chosen], rng)
    simulation = Simulation(jem, robot_spec("mlivr2"), obstacles=near)
    model, boxes, bit = simulation.model, [*jem.boxes, *near], gripper_bit(limb)
    geoms = [model.geom(scene_name(BOX, box.id)).id for box in boxes]
    for point in (FREE, *chosen.tolist()):
        before = model.geom_contype.copy()
        simulation._grippers.set_contacts(limb, point)
        met = model.geom_contype[geoms] & bit != 0
        free = np.array(
            [
                point != FREE and behind(box, jem.positions[point], jem.normals[point])
                for box in boxes
            ]
        )
        assert (met == ~free).all()
        assert free.any() == (point != FREE)
        assert ((model.geom_contype ^ before) & ~bit == 0).all()


@pytest.mark.parametrize(("distance", "angle"), [(0.99, 0.99), (1.01, 0.5), (0.5, 1.01)])
def test_a_gripper_captures_up_to_a_distance_and_an_angle(distance, angle):
    physics = Physics(capture_distance=0.02, capture_angle=0.05)
    assert physics.captures(0.02 * distance, 0.05 * angle) == (max(distance, angle) < 1.0)


def test_the_error_of_a_gripper_is_its_distance_and_its_angle(noisy, plan):
    """The robot is moved as a whole, so that each gripper is off its point by as much."""
    data, grippers, held = noisy.data, noisy._grippers, noisy._grippers.points
    grippers._positions, grippers._turns = (
        noisy.grasp_map.positions.copy(), np.tile(np.eye(3), (len(noisy.grasp_map), 1, 1))
    )  # fmt: skip
    shift, turn = np.array([0.004, -0.003, 0.012]), Rotation.from_rotvec([0.01, 0.02, -0.02])
    place, angle = data.qpos[:3].copy(), Rotation.from_quat(data.qpos[3:7], scalar_first=True)
    for limb in range(2):
        pivot = noisy.grasp_map.positions[held[limb]]
        data.qpos[:3] = pivot + turn.apply(place - pivot) + shift
        data.qpos[3:7] = (turn * angle).as_quat(scalar_first=True)
        mujoco.mj_kinematics(noisy.model, data)
        assert grippers.error(limb, held[limb]) == pytest.approx((0.013, 0.03), abs=1e-5)


def test_a_gripper_moves_with_the_limbs_that_hold(jem, plan):
    """By kinematics: the base is put where the gripper that holds has stayed, a moment later."""
    simulation, start = Simulation(jem, plan.world.robot), plan.configuration(0)
    limb, rng, moment = plan.steps[0].limb, np.random.default_rng(3), 1e-6
    simulation.reset(*start, [jem.index(point) for point in plan.stances[0]])
    grippers, data = simulation._grippers, simulation.data
    grippers.detach(limb)
    speeds = rng.uniform(-0.5, 0.5, 12)
    found = grippers.relative_speed(limb, speeds)
    held, here = (pose_of(grippers, each) for each in (1 - limb, limb))
    data.qpos[7:] += moment * speeds
    mujoco.mj_kinematics(simulation.model, data)
    moved = held @ np.linalg.inv(pose_of(grippers, 1 - limb)) @ pose_of(grippers, limb)
    turn = Rotation.from_matrix(moved[:3, :3] @ here[:3, :3].T).magnitude()
    away = np.linalg.norm(moved[:3, 3] - here[:3, 3])
    np.testing.assert_allclose(found, np.array([away, turn]) / moment, rtol=1e-4)


def pose_of(grippers, limb):
    """Where a gripper is, shape (4, 4)."""
    out = np.eye(4)
    out[:3, 3], out[:3, :3] = grippers.pose(limb)
    return out


def test_the_sensor_of_a_gripper_is_as_noisy_as_stated(noisy, checked_graph, plan):
    guidance, found = noisy._guidance, []
    trajectory = step_trajectory(checked_graph, plan, 0, Durations(), period=0.5)
    for _ in range(1500):
        guidance.start(plan.steps[0].limb, noisy.grasp_map.index(plan.steps[0].from_point))
        guidance.correct(trajectory, 0)
        found.append(guidance._filtered)
    found = np.array(found)
    assert found[:, :3].std() == pytest.approx(noisy.disturbance.ranges.sensor_position, rel=0.04)
    assert found[:, 3:].std() == pytest.approx(noisy.disturbance.ranges.sensor_angle, rel=0.04)
    guidance._noise = np.zeros(6)  # what is left is the error of the gripper alone
    guidance.start(plan.steps[0].limb, noisy.grasp_map.index(plan.steps[0].from_point))
    guidance.correct(trajectory, 0)
    middle = found.mean(axis=0) - guidance._filtered
    assert np.abs(middle / np.repeat([0.004, 0.03], 3)).max() < 5.0 / np.sqrt(1500)


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
