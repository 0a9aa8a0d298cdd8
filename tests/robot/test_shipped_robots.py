"""Robots that ship, their figures and walks, and cargo, against MuJoCo and Pinocchio."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from plans import first_steps

from mlivr_gym import robot_spec, stance_graph
from mlivr_gym.collisions.limb_shapes import cargo_capsules
from mlivr_gym.extensions.reaction.fastest import step_reactions
from mlivr_gym.extensions.station_load.spectra import station_load
from mlivr_gym.motion.plan_checks import check_motion
from mlivr_gym.planners import Planner
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.robot.specification import ROBOTS
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.inverse_dynamics import robot_model
from mlivr_gym.simulation.scene import robot_alone, scene_spec, set_configuration
from mlivr_gym.simulation.timing import plan_trajectory
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


ON_TOP = Cargo(10.0, (0.3, 0.4, 0.2))
BESIDE = Cargo(30.0, (0.45, 0.25, 0.3), (0.02, 0.26, 0.05))
CARGO_START, CARGO_GOAL = ("D2a:4", "D2b:4"), (4.0, 0.0, 0.42)


def with_cargo(cargo):
    return replace(robot_spec("mlivr2"), cargo=cargo)


@pytest.fixture(scope="module")
def part(jem):
    """The part of the module in which the walk is."""
    return jem.subset(jem.positions[:, 0] < 5.0)


@pytest.fixture(scope="module")
def graph(part):
    return stance_graph(part, with_cargo(BESIDE))


@pytest.fixture(scope="module")
def plan(graph):
    return Planner(graph).plan(CARGO_START, CARGO_GOAL, "steps").unwrap()


@pytest.mark.parametrize("cargo", [ON_TOP, BESIDE])
def test_body_and_cargo_have_the_inertia_that_mujoco_gives_two_boxes(cargo):
    robot, spec = with_cargo(cargo), mujoco.MjSpec()
    both = spec.worldbody.add_body()
    both.add_freejoint()
    box = mujoco.mjtGeom.mjGEOM_BOX
    both.add_geom(type=box, size=[0.1] * 3, mass=20.0)
    place = cargo.centre or (0.0, 0.0, 0.1 + 0.5 * cargo.size[2])
    both.add_geom(type=box, size=0.5 * np.array(cargo.size), pos=place, mass=cargo.mass)
    truth, base = spec.compile(), robot_model(robot)

    def figures(model, body):
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        turn = turn.reshape(3, 3)
        about = turn @ np.diag(model.body_inertia[body]) @ turn.T
        return model.body_mass[body], model.body_ipos[body], about

    for ours, theirs in zip(figures(base, base.body("base").id), figures(truth, 1), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


@pytest.mark.parametrize("cargo", [ON_TOP, BESIDE, Cargo(1.0, 0.2)])
def test_capsules_cover_the_cargo_and_stay_within_the_extent(cargo):
    robot, rng = with_cargo(cargo), np.random.default_rng(1)
    points = robot.cargo_frame[:3, 3] + rng.uniform(-0.5, 0.5, (2000, 3)) * cargo.edges
    ends, radii = cargo_capsules(robot)
    along = ends[:, 1] - ends[:, 0]
    share = ((points[:, None] - ends[:, 0]) * along).sum(axis=2) / (along**2).sum(axis=1).clip(
        1e-12
    )
    nearest = ends[:, 0] + share.clip(0.0, 1.0)[..., None] * along
    inside = np.linalg.norm(points[:, None] - nearest, axis=2) <= radii + 1e-12
    assert inside.any(axis=1).all()
    assert (np.linalg.norm(ends, axis=2) + radii[:, None]).max() <= robot.extent
    beyond = (
        np.abs(ends - robot.cargo_frame[:3, 3]).max(axis=(0, 1)) + radii.max() - 0.5 * cargo.edges
    )
    assert beyond.max() < 0.25 * cargo.edges.max()


def test_no_limb_and_no_box_comes_near_the_cargo_on_a_walk(part, graph, plan):
    """MuJoCo measures distances from the box itself; without cargo the walk would meet it."""
    model = scene_spec(part, graph.robot).compile()
    data, cargo = mujoco.MjData(model), model.geom("cargo").id
    fixed = "limb0/base", "limb1/base", "limb0/shoulder", "limb1/shoulder", "body", "cargo"
    others = [
        g for g in range(model.ngeom)
        if model.geom(g).name and not model.geom(g).name.startswith(fixed) and model.geom(g).contype
    ]  # fmt: skip

    def nearest(walk):
        way, least = plan_trajectory(graph, walk, period=0.1), np.inf
        for k in range(len(way.times)):
            set_configuration(
                model, data, way.base_positions[k], way.base_quaternions[k], way.joint_positions[k]
            )
            for g in others:
                least = min(least, mujoco.mj_geomDistance(model, data, g, cargo, 0.1, None))
        return least

    assert nearest(plan) >= 0.02 - 1e-3
    free = Planner(stance_graph(part)).plan(CARGO_START, CARGO_GOAL, "steps").unwrap()
    assert nearest(free) < 0.02


def test_a_walk_with_cargo_is_carried_out_and_heavier_cargo_takes_longer(part, graph, plan):
    execution = execute(graph, plan)
    assert execution.failure is None
    peaks = station_load(execution.recording).peak_forces
    planned = step_reactions(graph, plan)
    for one, peak in zip(planned, peaks, strict=True):
        assert one.peak_force == pytest.approx(peak, rel=0.1)
    heavy = stance_graph(part, with_cargo(replace(BESIDE, mass=100.0)))
    slower = step_reactions(heavy, replace(plan, world=replace(plan.world, robot=heavy.robot)))
    assert sum(one.seconds for one in slower) > 1.1 * sum(one.seconds for one in planned)
