"""A bag is picked up, carried and stowed: coal and MuJoCo check what was planned."""

import coal
import mujoco
import numpy as np
import pinocchio
import pytest
from coal_ruler import apart, capsule, solid
from pinocchio_robots import pinocchio_robot

from mlivr_gym import robot_spec, stance_graph
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.errors import MlivrError, NoPlanError
from mlivr_gym.extensions.cargo import cargo_mission
from mlivr_gym.extensions.cargo.arm_motion import LimbScene
from mlivr_gym.extensions.cargo.cargo_mission import _grasp, loaded_robot, plan_cargo_mission
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.simulation.parameters import Limits, Physics
from mlivr_gym.simulation.scene import robot_alone, set_configuration

BAG = Cargo(10.0, 0.2)
START, PICK, STOW = ("D3a:8", "D3a:1", "D3a:4"), "D2b:3", "F2b:4"


@pytest.fixture(scope="module")
def graph(jem):
    """The points of two racks of deck and forward wall that meet at x = 2.9 m."""
    keep = np.isin(jem.faces, ["deck", "forward"]) & (np.abs(jem.positions[:, 0] - 2.9) < 0.2)
    return stance_graph(jem.subset(keep, "bay"), "mlivr3")


@pytest.fixture(scope="module", autouse=True)
def short_searches():
    """Searches for walks of three limbs, which lead nowhere here, end soon."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cargo_mission, "LIMIT", 100)
        yield


@pytest.fixture(scope="module")
def mission(graph):
    return plan_cargo_mission(graph, START, PICK, STOW, BAG, limbs=[1, 0])


@pytest.fixture(scope="module")
def parts(mission):
    return mission.execute()


def test_the_limb_with_the_cheapest_walks_carries_and_the_others_walk(graph, mission):
    assert mission.limb == 0
    one = plan_cargo_mission(graph, START, PICK, STOW, BAG, limbs=[1])
    assert one.limb == 1
    assert sum(plan.cost for plan in one.plans) >= sum(plan.cost for plan in mission.plans)
    walk, carry = mission.plans
    assert walk.world.robot.limbs == 3
    assert carry.world.robot.limbs == 2
    assert carry.stances[0] == walk.stances[-1][1:]
    assert not graph.obstacles
    for got, expected in zip(carry.configuration(0), walk.configuration(-1), strict=True):
        np.testing.assert_allclose(got, expected[1:] if got.ndim == 2 else expected, atol=1e-6)


def test_gripper_and_bag_are_where_the_points_are(graph, mission):
    """MuJoCo puts the robot in place."""
    model = robot_alone(graph.robot).compile()
    data, (pick, fold, stow) = mujoco.MjData(model), (one.path for one in mission.motions)
    for path, point in ((pick, PICK), (stow, STOW)):
        end = path.samples(2)
        place = end.base_positions[-1], end.base_quaternions[-1], end.joint_positions[-1]
        set_configuration(model, data, *place)
        k = graph.grasp_map.index(point)
        normal = graph.grasp_map.rotations[k][:, 2]
        grasp = data.site(f"limb{mission.limb}/grasp")
        handle = graph.grasp_map.positions[k] + BAG.edges[2] * normal
        np.testing.assert_allclose(grasp.xpos, handle, atol=1e-6)
        np.testing.assert_allclose(grasp.xmat.reshape(3, 3)[:, 2], -normal, atol=1e-6)
    limb = mission.limb
    np.testing.assert_array_equal(pick.knots[-1, limb], fold.knots[0, limb])
    np.testing.assert_array_equal(fold.knots[-1, limb], stow.knots[0, limb])


def test_a_limb_with_a_bag_is_clear_where_coal_and_the_plain_definition_say_so(graph):
    robot, rng, clearance = graph.robot, np.random.default_rng(4), graph.settings.clearance
    boxes, model = graph.grasp_map.boxes, robot_alone(graph.robot).compile()
    data, seen = mujoco.MjData(model), set()
    scene = LimbScene(robot, 0, BAG, (graph.grasp_map, ()))
    position, quaternion, joints = graph.configuration(graph.state(START))
    scene.stand(position, quaternion, joints)
    held = "limb0/wrist_3", "limb0/gripper"
    names = [model.geom(g).name for g in range(model.ngeom)]
    parts = [g for g, one in enumerate(names) if one and not one.startswith(held)]
    walls = [solid(box) for box in boxes]
    for _ in range(150):
        joints = joints.copy()
        joints[0] = rng.uniform(-np.pi, np.pi, 6)
        set_configuration(model, data, position, quaternion, joints)
        grasp = data.site("limb0/grasp")
        turn = grasp.xmat.reshape(3, 3)
        middle = grasp.xpos + 0.5 * BAG.edges[2] * turn[:, 2]
        bag = coal.Box(*BAG.edges), coal.Transform3s(turn, middle)
        shapes = list(walls)
        for g in parts:
            size, axes, where = (
                model.geom_size[g],
                data.geom_xmat[g].reshape(3, 3),
                data.geom_xpos[g],
            )
            half = size[1] * axes[:, 2]
            if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_CAPSULE:
                shapes.append(capsule(size[0], where - half, where + half))
            else:
                shapes.append((coal.Box(*(2.0 * size)), coal.Transform3s(axes, where)))
        gap = min(apart(bag, shape) for shape in shapes)
        touching = [
            any(
                one.startswith("limb0/") and "/base/" not in one
                for contact in contacts(robot, boxes, (position, quaternion, joints), within)
                for one in (contact.first, contact.second)
            )
            for within in (clearance - 1e-3, clearance + 1e-3)
        ]
        if abs(gap - clearance) < 1e-3 or touching[0] != touching[1]:
            continue
        expected = gap >= clearance and not touching[0]
        assert scene.is_clear(joints[0]) == expected
        seen.add((gap >= clearance, touching[0]))
    assert seen == {(True, True), (True, False), (False, True), (False, False)}


def test_the_limb_is_clear_all_along_its_motion_with_the_bag(graph, mission):
    """On the way that is executed, with the bag near its point on the lines along the normal."""
    scene = LimbScene(graph.robot, mission.limb, BAG, (graph.grasp_map, ()))
    for motion, point, number in ((mission.motions[1], PICK, 0), (mission.motions[2], STOW, -1)):
        path, handle = motion.path, _grasp(graph, point, BAG.edges[2])
        start = path.samples(2)
        scene.stand(start.base_positions[0], start.base_quaternions[0], start.joint_positions[0])
        for segment in path.segments:
            at = handle if segment is path.segments[number] else None
            joints = segment.joints_at(np.linspace(0.0, 1.0, 100))[:, mission.limb]
            assert all(scene.is_clear(q, at) for q in joints)


def test_the_mission_is_carried_out(mission, parts):
    assert list(parts) == ["pick up", "fold", "carry", "stow"]
    for part in parts.values():
        assert part.failure is None
        assert part.peaks.grasp_force.max() < 1.2 * Limits().grasp_force
    for name, motion in zip(("pick up", "fold", "stow"), mission.motions, strict=True):
        place, _, joints = parts[name].recording.configuration(-1)
        limb, path = mission.limb, motion.path
        np.testing.assert_allclose(joints[limb], path.knots[-1, limb], atol=1e-3)
        assert np.linalg.norm(place - path.base_position) < Physics().capture_distance


def test_pinocchio_agrees_on_the_mass_of_a_loaded_limb():
    robot = robot_spec("mlivr3")
    ours, truth = robot_alone(loaded_robot(robot, 1, BAG)).compile(), pinocchio_robot(robot)
    place = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, robot.tool_length + 0.1]))
    box = pinocchio.Inertia.FromBox(BAG.mass, *BAG.edges)
    truth.appendBodyToJoint(truth.getJointId("limb1/joint6"), box, place)
    # The base lies along the world, in whose axes MuJoCo has its velocity.
    q = np.concatenate([np.zeros(6), [1.0], np.random.default_rng(0).uniform(-1, 1, truth.nv - 6)])
    data, mass = mujoco.MjData(ours), np.zeros((ours.nv, ours.nv))
    set_configuration(ours, data, q[:3], np.array([1.0, 0.0, 0.0, 0.0]), q[7:].reshape(-1, 6))
    mujoco.mj_fullM(ours, data, mass)
    expected = np.triu(pinocchio.crba(truth, truth.createData(), q))
    np.testing.assert_allclose(np.triu(mass), expected, atol=1e-9)


def test_what_cannot_be_is_refused(graph):
    with pytest.raises(MlivrError, match="unknown graspable point 'X'"):
        plan_cargo_mission(graph, START, "X", STOW, BAG)
    with pytest.raises(NoPlanError, match="limb 5: limb is 5; robot 'mlivr3' has limbs 0 to 2"):
        plan_cargo_mission(graph, START, PICK, STOW, BAG, limbs=[5])
    with pytest.raises(NoPlanError, match="': limb 0: robot 'mlivr2' has 2 limbs"):
        plan_cargo_mission(stance_graph(), ("D2a:4", "D2b:4"), "A2b:4", "A4b:4", BAG)
    assert not graph.obstacles
