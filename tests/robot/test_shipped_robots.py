"""The robots that ship as files: their figures, a plan and a walk in MuJoCo."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from plans import first_steps

from mlivr_gym import robot_spec, stance_graph
from mlivr_gym.motion.plan_checks import check_motion
from mlivr_gym.planners import Planner
from mlivr_gym.robot.specification import ROBOTS
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.scene import robot_alone, set_configuration
from mlivr_gym.stances.random_states import random_state

FILES = [name for name in ROBOTS if name.startswith("mlivr2-")]

START, GOAL = ("D2a:3", "D2b:4"), ("D4a:0", "D4b:1")
"""A walk two racks to port; its goal is where the base of the second stance is."""

PUBLISHED = {
    "mlivr2-ur3e": (11.2, 11.2),
    "mlivr2-ur10e": (33.5, 33.5),
    "mlivr2-iiwa": (29.9, 29.9),
    "mlivr2-unequal": (33.5, 20.6),
}
"""Masses of the arms in the makers' data sheets [kg]."""

IIWA = (
    ((0, 0, 0.1575), (0, 0, 0), 5.76, (0, -0.03, 0.12), (0.033, 0.0333, 0.0123)),
    ((0, 0, 0.2025), (90, 0, 180), 6.35, (0.0003, 0.059, 0.042), (0.0305, 0.0304, 0.011)),
    ((0, 0.2045, 0), (90, 0, 180), 3.5, (0, 0.03, 0.13), (0.025, 0.0238, 0.0076)),
    ((0, 0, 0.2155), (90, 0, 0), 3.5, (0, 0.067, 0.034), (0.017, 0.0164, 0.006)),
    ((0, 0.1845, 0), (-90, 180, 0), 3.5, (0.0001, 0.021, 0.076), (0.01, 0.0087, 0.00449)),
    ((0, 0, 0.2155), (90, 0, 0), 1.8, (0, 0.0006, 0.0004), (0.0049, 0.0047, 0.0036)),
    ((0, 0.081, 0), (-90, 180, 0), 1.2, (0, 0, 0.02), (0.001, 0.001, 0.001)),
)
"""Origin [m] and roll, pitch, yaw [deg] of each joint of the iiwa 14 about z of the link before,
and mass, centre and inertia of its link, as Drake's `iiwa14_no_collision.urdf` has them."""

OTHER_SENSE = np.array([1, -1, 1, 1, -1, 1])
"""Joints 2 and 6 of the iiwa turn in the other sense than those of the robot that ships."""


@pytest.mark.parametrize("name", FILES)
def test_the_arms_weigh_what_their_data_sheets_say(name):
    """The description's masses of base links are marked there as possibly incorrect."""
    robot = robot_spec(name)
    assert robot.name == name
    assert robot.source
    for limb, mass in enumerate(PUBLISHED[name]):
        dynamics = robot.dynamics_of(limb)
        assert dynamics.base_mass + sum(dynamics.masses) == pytest.approx(mass, rel=0.06)


def iiwa_model(locked_angle):
    """Pinocchio's model of the iiwa with joint 3 locked."""
    model, parent, within = pin.Model(), 0, pin.SE3.Identity()
    for k, (place, angles, mass, centre, inertia) in enumerate(IIWA):
        turn = pin.rpy.rpyToMatrix(*np.deg2rad(angles).tolist())
        within = within * pin.SE3(turn, np.array(place, dtype=float))
        if k == 2:
            within = within * pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, locked_angle), np.zeros(3))
        else:
            parent = model.addJoint(parent, pin.JointModelRZ(), within, f"joint{k + 1}")
            within = pin.SE3.Identity()
        figures = pin.Inertia(mass, np.array(centre, dtype=float), np.diag(inertia))
        model.appendBodyToJoint(parent, figures, within)
    return model


def test_the_links_of_the_iiwa_have_the_masses_of_its_description():
    """The mass matrix at random postures: the locked joint joins two links rigidly."""
    robot = replace(robot_spec("mlivr2-iiwa"), gripper_mass=0.0)
    rotors = np.diag(robot.dynamics_of(0).rotor_inertias)
    model, scene = iiwa_model(robot.limb.locked_angle), robot_alone(robot).compile()
    data, mine, rng = model.createData(), mujoco.MjData(scene), np.random.default_rng(0)
    for _ in range(20):
        joints = rng.uniform(*robot.limb.limits.T, size=(2, 6))
        set_configuration(scene, mine, np.zeros(3), np.array([1.0, 0, 0, 0]), joints)
        matrix = np.zeros((scene.nv, scene.nv))
        mujoco.mj_fullM(scene, mine, matrix)
        expected = pin.crba(model, data, joints[0] * OTHER_SENSE)
        expected = np.triu(expected) + np.triu(expected, 1).T
        expected = OTHER_SENSE[:, None] * expected * OTHER_SENSE
        first = scene.jnt_dofadr[scene.joint("limb0/joint1").id]
        block = slice(first, first + 6)
        np.testing.assert_allclose(matrix[block, block] - rotors, expected, atol=2e-5)


@pytest.mark.parametrize("name", ["mlivr2-iiwa", "mlivr2-unequal"])
def test_a_robot_that_ships_plans_a_walk_and_walks_in_mujoco(jem, name):
    """Over deck and walls of the part of the module in which the walk is."""
    part = (jem.positions[:, 0] > 1.5) & (jem.positions[:, 0] < 5.5) & (jem.positions[:, 2] < 0.5)
    graph = stance_graph(jem.subset(part), robot=name)
    goal = graph.configuration(graph.state(GOAL))[0].tolist()
    plan = Planner(graph).plan(START, goal, "steps").unwrap()
    assert len(graph) > 1000
    assert 2 <= len(plan.steps) <= 8
    check_motion(plan.query, plan.world, plan.motion, graph.grasp_map)
    execution = execute(graph, first_steps(plan, 2))
    assert execution.failure is None
    assert len(execution.captures) == 2


@pytest.mark.parametrize("name", ["mlivr3", "mlivr4"])
def test_robots_of_more_limbs_walk_in_mujoco(name):
    """To the farthest base of those two steps away from a drawn stance."""
    graph = stance_graph(robot=name)
    start = random_state(graph, np.random.default_rng(1))
    state = start
    for _ in range(2):
        steps = graph.successors(state)
        away = np.linalg.norm(steps.base_position - graph.configuration(start)[0], axis=1)
        k = int(away.argmax())
        state = steps.after(state, k)
    goal = {"goal": steps.base_position[k], "goal_tolerance": 0.05}
    plan = Planner(graph).plan(start, cost="steps", **goal).unwrap()
    assert len(plan.steps) > 0
    execution = execute(graph, plan)
    assert execution.failure is None
    assert len(execution.captures) == len(plan.steps)
