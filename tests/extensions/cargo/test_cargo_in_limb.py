"""Cargo in a folded limb against Pinocchio and MuJoCo, and walks of the limbs that are free."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio
import pytest
from pinocchio_robots import pinocchio_robot

from mlivr_gym import RobotSpec, robot_spec, stance_graph
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.errors import RobotError
from mlivr_gym.extensions.cargo.carrying import carrying_robot
from mlivr_gym.planners import Planner
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.settings import Settings
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.inverse_dynamics import robot_model
from mlivr_gym.simulation.scene import robot_alone, set_configuration

CLEARANCE = Settings().clearance
BAG = Cargo(12.0, (0.3, 0.4, 0.2))
LIMB = 1


@pytest.fixture(scope="module")
def carrier():
    return carrying_robot(robot_spec("mlivr3"), LIMB, BAG)


def folded(robot, carrier):
    """Joint angles of all limbs of the robot with the carrying limb as it is locked."""
    joints = np.tile([0.0, -np.pi / 2, np.pi / 2, 0.0, np.pi / 2, 0.0], (robot.limbs, 1))
    joints[LIMB] = carrier.cargo.limb.joints
    return joints


def test_body_has_the_inertia_that_pinocchio_gives_the_locked_limb_with_its_bag(carrier):
    whole = pinocchio_robot(robot_spec("mlivr3"))
    place = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, carrier.tool_length + 0.1]))
    box = pinocchio.Inertia.FromBox(BAG.mass, *BAG.size)
    last = whole.getJointId(f"limb{LIMB}/joint6")
    whole.appendBodyToJoint(last, box, place)
    reference, locked = pinocchio.neutral(whole), []
    for k in range(6):
        joint = whole.getJointId(f"limb{LIMB}/joint{k + 1}")
        reference[whole.joints[joint].idx_q] = carrier.cargo.limb.joints[k]
        locked.append(joint)
    truth = pinocchio.buildReducedModel(whole, locked, reference).inertias[1]
    # The bases of the limbs that walk are bodies of their own in MuJoCo.
    model = robot_model(carrier)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ours = pinocchio.Inertia.Zero()
    for name in ("base", "limb0", "limb1"):
        body = model.body(name).id
        turn = data.ximat[body].reshape(3, 3)
        about = turn @ np.diag(model.body_inertia[body]) @ turn.T
        ours += pinocchio.Inertia(model.body_mass[body], data.xipos[body], about)
    assert ours.mass == pytest.approx(truth.mass)
    np.testing.assert_allclose(ours.lever, truth.lever, atol=1e-9)
    np.testing.assert_allclose(ours.inertia, truth.inertia, atol=1e-8)


def test_locked_shapes_lie_where_mujoco_puts_those_of_the_limb(carrier):
    robot, models = robot_spec("mlivr3"), []
    for one, joints in ((robot, folded(robot, carrier)), (carrier, np.zeros((2, 6)))):
        model = robot_alone(one).compile()
        data = mujoco.MjData(model)
        set_configuration(model, data, np.zeros(3), np.array([1.0, 0, 0, 0]), joints)
        models.append((model, data))
    (whole, at), (model, data) = models
    names = [whole.geom(g).name for g in range(whole.ngeom)]
    names = [name for name in names if name.startswith(f"limb{LIMB}/")]
    assert names
    locked = [data.geom(g) for g in range(model.ngeom) if model.geom(g).name.startswith("cargo/")]
    assert len(locked) == len(names)
    for name in names:
        assert min(np.abs(at.geom(name).xpos - one.xpos).max() for one in locked) < 1e-5
    grasp = at.site(f"limb{LIMB}/grasp")
    middle = grasp.xpos + 0.1 * grasp.xmat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(data.geom("cargo").xpos, middle, atol=1e-9)
    np.testing.assert_allclose(data.geom("cargo").xmat, grasp.xmat, atol=1e-9)


def test_a_folded_limb_touches_neither_itself_nor_the_body_nor_its_bag(carrier):
    robot = robot_spec("mlivr3")
    here = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), folded(robot, carrier)
    close = contacts(robot, (), here, CLEARANCE - 1e-4)
    mine = f"limb{LIMB}/"
    assert not [
        c for c in close if c.first.startswith(mine) and c.second.startswith((mine, "body"))
    ]
    model = robot_alone(carrier).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bag = model.geom("cargo").id
    others = ["body"] + [
        f"cargo/limb/{k}"
        for k, (link, _, _) in enumerate(carrier.cargo.limb_capsules)
        if link not in ("wrist_3", "gripper")
    ]
    for name in others:
        other = model.geom(name).id
        assert mujoco.mj_geomDistance(model, data, bag, other, 1.0, None) >= CLEARANCE - 1e-6


def test_the_limbs_that_are_free_walk_with_the_bag(small_map, carrier):
    graph = stance_graph(small_map, carrier)
    start = tuple(graph.points[0])
    stances = [tuple(s) for s in graph.points.tolist()]
    for goal in stances:
        found = Planner(graph).plan(start, graph.posture(goal).base_position[0], "steps")
        if found.plan and found.plan.steps:
            break
    assert execute(graph, found.plan).failure is None


def test_a_carrying_robot_is_read_as_it_was_written(carrier):
    assert RobotSpec.from_dict(carrier.to_dict()) == carrier
    total = robot_model(robot_spec("mlivr3")).body_mass.sum() + BAG.mass
    assert robot_model(carrier).body_mass.sum() == pytest.approx(total)


def test_a_limb_that_cannot_carry_is_refused():
    robot = robot_spec("mlivr3")
    with pytest.raises(RobotError, match="two others must walk"):
        carrying_robot(robot_spec("mlivr2"), 0, BAG)
    with pytest.raises(RobotError, match="has limbs 0 to 2"):
        carrying_robot(robot, 3, BAG)
    with pytest.raises(RobotError, match="has cargo already"):
        carrying_robot(replace(robot, cargo=Cargo(1.0, 0.1)), 0, BAG)
    with pytest.raises(RobotError, match="each fold of it touches something"):
        carrying_robot(robot, 0, Cargo(1.0, 0.5, (0.0, 0.0, 0.0)))
