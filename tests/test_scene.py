import itertools
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from paper import NO_COLLISIONS
from scipy.spatial.transform import Rotation

from mlivr_gym import Limb, robot_spec, stance_graph
from mlivr_gym.dynamics import dynamics_spec
from mlivr_gym.errors import RenderError
from mlivr_gym.rendering import SceneRenderer, SceneWindow
from mlivr_gym.scene import scene_spec, set_configuration
from mlivr_gym.tasks import random_state
from mlivr_gym.ur_kinematics import forward_kinematics


@pytest.fixture(scope="module")
def model(jem):
    return scene_spec(jem, robot_spec("mlivr2")).compile()


def test_scene_holds_tracks_handrails_points_and_robot(jem, model):
    assert all(model.site(point) is not None for point in jem.ids)
    boxes = model.geom_type == mujoco.mjtGeom.mjGEOM_BOX
    tracks = boxes & np.isclose(model.geom_size[:, 0], 0.8763, atol=1e-4) & np.isclose(model.geom_size[:, 1], 0.0128)
    assert tracks.sum() == 46
    rails = boxes & (np.abs(model.geom_rgba - (0.10, 0.35, 0.75, 1)).max(axis=1) < 1e-6)
    assert rails.sum() == 18
    assert model.nv == 6 + 12 and (model.opt.gravity == 0.0).all()


def test_masses_are_the_published_ones(model):
    # Body 20 kg, six links of 17.70 kg in all and a gripper of 0.5 kg on each of two limbs.
    assert model.body_mass.sum() == pytest.approx(20.0 + 2 * (17.70 + 0.5))


@pytest.mark.parametrize("limbs", [2, 3, 4])
def test_mujoco_agrees_with_the_closed_form(jem, limbs):
    robot = robot_spec(f"mlivr{limbs}")
    model = scene_spec(jem, robot).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(5):
        position, turn = rng.uniform(-1, 1, 3), Rotation.random(rng=rng)
        joints = rng.uniform(-np.pi, np.pi, (limbs, 6))
        set_configuration(model, data, position, turn.as_quat(scalar_first=True), joints)
        for i in range(limbs):
            frame = forward_kinematics(joints[i], robot.limb.lengths)[6]
            mount = turn.as_matrix() @ robot.mount_rotations[i]
            origin = position + turn.as_matrix() @ robot.mount_positions[i]
            np.testing.assert_allclose(data.site(f"limb{i}/flange").xpos, origin + mount @ frame[:3, 3], atol=1e-9)
            found = data.site(f"limb{i}/flange").xmat.reshape(3, 3)
            np.testing.assert_allclose(found, mount @ frame[:3, :3], atol=1e-9)


@pytest.mark.parametrize("limbs", [2, 3])
def test_a_stance_puts_every_gripper_on_its_point(jem, limbs):
    graph = stance_graph(jem, f"mlivr{limbs}", NO_COLLISIONS)
    model = scene_spec(jem, graph.robot).compile()
    data = mujoco.MjData(model)
    state = random_state(graph, np.random.default_rng(1))
    set_configuration(model, data, *graph.configuration(state))
    for i, point in enumerate(graph.ids(state.stance)):
        np.testing.assert_allclose(data.site(f"limb{i}/grasp").xpos, data.site(point).xpos, atol=1e-6)


def test_exported_scene_loads_again(jem, model):
    spec = scene_spec(jem, robot_spec("mlivr2"))
    spec.compile()
    again = mujoco.MjModel.from_xml_string(spec.to_xml())
    assert (again.nbody, again.ngeom, again.nsite) == (model.nbody, model.ngeom, model.nsite)


LIMITS = (
    ((-2 * np.pi, 2 * np.pi),) * 6,
    ((-6.2, 6.2), (-3.1, 0.5), (-2.8, 2.8), (-1, 3), (0.1, 3.1), (-9, 9)),
)
"""Those of the UR5e, and a robot's own [rad]."""


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("make_spec", [scene_spec, dynamics_spec])
def test_joint_limits_are_the_robots_in_radians_also_after_export(jem, make_spec, limits):
    robot = replace(robot_spec("mlivr2"), limb=Limb(joint_limits=limits))
    spec = make_spec(jem, robot)
    model = spec.compile()
    for found in (model, mujoco.MjModel.from_xml_string(spec.to_xml())):
        for limb, k in itertools.product(range(2), range(6)):
            joint = found.joint(f"limb{limb}/joint{k + 1}")
            np.testing.assert_allclose(joint.range, limits[k], atol=1e-4)
            assert found.jnt_limited[joint.id] == (make_spec is scene_spec)


def test_a_joint_meets_a_stop_only_beyond_the_robots_limits(jem):
    robot = replace(robot_spec("mlivr2"), limb=Limb(joint_limits=((-2.0, 2.0),) * 6))
    model = scene_spec(jem, robot).compile()
    data = mujoco.MjData(model)
    straight = np.array([4.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])
    for angle, stops in ((1.99, 0), (-1.99, 0), (2.01, 12), (-2.01, 12)):
        set_configuration(model, data, *straight, np.full((2, 6), angle))
        limit = mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
        assert np.count_nonzero(data.efc_type == limit) == stops


def test_a_users_own_map_has_a_scene(ladder):
    model = scene_spec(ladder, robot_spec("mlivr2")).compile()
    assert model.site("R0:0") is not None


def test_pictures_show_the_robot_or_say_what_is_missing(jem, graph):
    try:
        renderer = SceneRenderer(jem, graph.robot, 160, 90)
    except RenderError as error:
        assert "MUJOCO_GL" in str(error)
        return
    states = [graph.state(stance) for stance in (("D1a:4", "D1b:4"), ("D2a:4", "D2a:3"))]
    first, second = (renderer.render(*graph.configuration(state)) for state in states)
    renderer.close()
    assert first.shape == (90, 160, 3) and (first != second).any() and first.std() > 10


def test_a_window_without_a_screen_is_one_clear_error(jem, graph, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RenderError, match="needs a screen"):
        SceneWindow(jem, graph.robot)
