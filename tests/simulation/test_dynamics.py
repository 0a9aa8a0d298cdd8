"""Masses and kinematics of the simulated robot, and which robots are simulated."""

from dataclasses import asdict, replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from pinocchio_robots import pinocchio_robot
from scipy.spatial.transform import Rotation

from mlivr_gym import Limb, robot_spec
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.dh_table import frames_of_dh, ur_dh
from mlivr_gym.simulation.dynamics import dynamics_spec
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.scene import set_configuration
from mlivr_gym.simulation.simulator import Simulation


@pytest.mark.parametrize("limbs", [2, 3, 4])
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
            Rotation.random(None, rng),
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


UNKNOWN = Limb(*frames_of_dh(ur_dh(0.1807, -0.6127, -0.5, 0.17415, 0.11985, 0.11655)))
"""Lengths of no arm that ships."""


def test_another_arm_is_not_simulated_with_masses_of_the_ur5e(small_map, checked_graph, plan):
    robot = replace(plan.world.robot, name="own", limb=UNKNOWN)
    told = r"'own' cannot be simulated: .*none of ur3e, ur5e, ur10e.*`dynamics`"
    refused = pytest.raises(RobotError, match=told)
    with refused:
        execute(checked_graph, replace(plan, world=replace(plan.world, robot=robot)))
    with refused:
        dynamics_spec(small_map, robot)
    with refused:
        MlivrEnv(robot, map=small_map, dynamics="mujoco", collisions=False)


@pytest.mark.parametrize(("name", "links", "base"), [("ur3e", 8.7985, 2.0), ("ur10e", 29.104, 4.0)])
def test_arms_of_the_maker_have_the_makers_masses(jem, name, links, base):
    """Sums of the masses of the manufacturer's description."""
    by_lengths = robot_spec({"name": name, "limb": name})
    by_name = robot_spec({"name": name, "limb": asdict(UNKNOWN), "dynamics": name})
    for robot in (by_lengths, by_name):
        simulation = Simulation(jem, robot)
        assert simulation.model.body_mass.sum() == pytest.approx(20.0 + 2 * (links + base + 0.5))
    assert robot_spec(by_name.to_dict()) == by_name


def test_figures_of_a_robot_file_are_simulated(jem):
    figures = asdict(robot_spec("mlivr2").dynamics_of(0))
    figures["masses"] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    figures["torque_limits"] = [10.0, 20.0, 30.0, 4.0, 5.0, 6.0]
    robot = robot_spec({"name": "own", "dynamics": figures})
    model = dynamics_spec(jem, robot).compile()
    links = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    for i in range(2):
        found = [float(model.body(f"limb{i}/{link}").mass[0]) for link in links]
        assert found == figures["masses"]
        ranges = [model.actuator(f"limb{i}/joint{k}").forcerange[1] for k in range(1, 7)]
        assert ranges == figures["torque_limits"]
    assert robot.fingerprint == robot_spec({"name": "own"}).fingerprint
    figures["inertias"] = [[1.0, 1.0, 3.0, 0.0, 0.0, 0.0]] * 6
    with pytest.raises(RobotError, match=r"inertias\[0\] has the principal moments 1, 1, 3"):
        robot_spec({"name": "own", "dynamics": figures})
    with pytest.raises(RobotError, match=r"dynamics is 'ur7'; valid choices are 'ur3e'"):
        robot_spec({"name": "own", "dynamics": "ur7"})
