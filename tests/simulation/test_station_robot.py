"""The robot of two SSRMS-type arms: its published masses, its plans on the truss, and a walk."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import station_arm
from scipy.spatial.transform import Rotation

from mlivr_gym import Settings, robot_spec, stance_graph
from mlivr_gym.kinematics.manipulability import limb_manipulability
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.scene import robot_alone, set_configuration
from mlivr_gym.simulation.setup import Setup

ROBOT = robot_spec("ssrms2")
MASSES = (243.66, 105.98, 105.98, 314.88, 279.2, 105.98, 105.98, 243.66)
"""Published masses of the bodies B1 to B8 [kg]."""
INERTIAS = (
    (8.088, 3.061, 8.446, 0.0), (15.41, 2094.71, 2103.19, 49.52),
    (9.522, 1966.28, 1966.28, -39.95), (8.305, 3.061, 8.0386, 0.0),
    (12.13, 12.13, 3.061, 0.0), (9.336, 44.41, 44.41, 0.0),
)  # fmt: skip
"""Published inertias of B3 to B8, xx, yy, zz, xy [kg m^2]."""
MIDDLES = (
    (0.0, -0.2846, 0.0), (3.555, 0.0, 0.0), (3.555, 0.0, 0.0), (0.0, -0.2846, 0.0),
    (0.0, 0.0, -0.3513), (0.67945, 0.0, 0.0),
)  # fmt: skip


def arm_from_joint_2():
    """Pinocchio's model of joints 2 to 7 with the bodies B3 to B8."""
    model, parent = pin.Model(), 0
    for (place, axis), mass, (xx, yy, zz, xy), middle in zip(
        station_arm.JOINTS[1:], MASSES[2:], INERTIAS, MIDDLES, strict=True
    ):
        joint = pin.JointModelRevoluteUnaligned(np.eye(3)["xyz".index(axis)])
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array(place)), f"j{parent}")
        tensor = np.array([[xx, xy, 0], [xy, yy, 0], [0, 0, zz]])
        inertia = pin.Inertia(mass, np.array(middle), tensor)
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
    return model


@pytest.fixture(scope="module")
def graph():
    return stance_graph("truss", ROBOT, Settings(clearance=0.1))


@pytest.fixture(scope="module")
def plan(graph):
    goal = graph.configuration(graph.state(("forward:8", "forward:10")))[0].tolist()
    start = ("forward:1", "forward:3")
    return Planner(graph).plan(start, goal, "base", goal_tolerance=2.0).unwrap()


def test_the_model_weighs_what_is_published():
    model = robot_alone(ROBOT).compile()
    assert model.body_mass.sum() == pytest.approx(500.0 + 2.0 * sum(MASSES))


def test_the_joint_space_inertia_is_that_of_pinocchio():
    """It depends on masses, centres and inertias in the frames of all links that move."""
    model, arm, rng = robot_alone(ROBOT).compile(), arm_from_joint_2(), np.random.default_rng(0)
    data, truth_data = mujoco.MjData(model), arm.createData()
    rotors = np.diag(ROBOT.dynamics_of(0).rotor_inertias)
    for _ in range(10):
        joints = rng.uniform(-2.0, 2.0, (2, 6))
        set_configuration(model, data, np.zeros(3), np.array([1.0, 0, 0, 0]), joints)
        mujoco.mj_forward(model, data)
        whole = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, whole)
        for i in range(2):
            q = station_arm.SIGNS * (joints[i] - station_arm.ZEROS)
            truth = pin.crba(arm, truth_data, q)
            truth = np.triu(truth) + np.triu(truth, 1).T
            truth = station_arm.SIGNS[:, None] * truth * station_arm.SIGNS + rotors
            block = slice(6 + 6 * i, 12 + 6 * i)
            np.testing.assert_allclose(whole[block, block], truth, rtol=1e-6, atol=1e-3)


def test_limbs_hold_their_points_as_the_published_arm_does(graph):
    """Each stance with `w_m` of the joints that move above its threshold, of all joints too."""
    assert len(graph) > 1000
    limb, truss = ROBOT.limb, graph.grasp_map
    for k in np.random.default_rng(0).integers(len(graph), size=50).tolist():
        stance = graph.points[k].tolist()
        position, quaternion, joints = graph.configuration(graph.state(stance))
        base = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        for i, point in enumerate(stance):
            end, jacobian = station_arm.flange_in_mount(limb.locked_angle, joints[i])
            radial, up = np.array([1.0 - 2.0 * i, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
            mount = base @ np.column_stack([up, np.cross(radial, up), radial])
            world = position + base @ (0.5 * radial) + mount @ end[:3, 3]
            np.testing.assert_allclose(world, truss.positions[point], atol=1e-6)
            np.testing.assert_allclose(mount @ end[:3, 2], -truss.normals[point], atol=1e-6)
            w_m = limb_manipulability(jacobian[:, 1:], ROBOT.characteristic_length)
            assert w_m >= graph.limb_threshold - 1e-9
            assert limb_manipulability(jacobian, ROBOT.characteristic_length) >= w_m


@pytest.mark.slow
def test_it_walks_along_the_truss_in_mujoco(graph, plan):
    setup = Setup.of("station", "station", "station")
    simulation = setup.simulation(graph.grasp_map, ROBOT)
    walk = execute(graph, plan, setup.timing, simulation=simulation)
    assert walk.failure is None
    assert len(walk.captures) == len(plan.steps)
    assert max(capture.distance for capture in walk.captures) < 0.01
    assert walk.peaks.joint_torque.max() < 0.6 * 2332.0
    joints, times = walk.recording.joint_positions, walk.recording.times
    assert np.abs(np.gradient(joints, times, axis=0)).max() < np.deg2rad(4.0)
