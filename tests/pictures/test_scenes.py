"""What a scene holds and where it is drawn: camera, obstacles, plan, lamps."""

import gc
import weakref
from unittest.mock import Mock

import mujoco
import numpy as np
import pytest
from gl_there import gl_or_skip

from mlivr_gym import Box, robot_spec
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.figures import BASE_COLOUR
from mlivr_gym.pictures.rendering import GHOST_OPACITY, SceneRenderer
from mlivr_gym.pictures.route import PATH_RADIUS, Route, base_paths, plan_base_path
from mlivr_gym.pictures.studio import studio_spec
from mlivr_gym.robot.visuals import LIMB_COLOURS
from mlivr_gym.simulation.scene import compile_spec, rgba, scene_spec
from mlivr_gym.simulation.timing import step_trajectory


@pytest.mark.parametrize("aspect", [2.0, 0.5])
def test_balls_are_inside_the_picture_and_one_touches_its_edge(aspect):
    rng, size = np.random.default_rng(0), np.array([round(300 * aspect), 300])
    around = rng.normal(size=(4000, 3))
    around *= 0.15 / np.linalg.norm(around, axis=1, keepdims=True)
    for azimuth, elevation in ((84.0, -8.0), (200.0, 40.0)):
        places = rng.uniform(-1.0, 1.0, (12, 3))
        camera = Camera((0.1, -0.2, 0.3), azimuth=azimuth, elevation=elevation)
        camera = camera.seeing(places, 0.15, aspect)
        pixels = camera.pixels((places[:, None] + around).reshape(-1, 3), *size)
        assert 0.0 <= min(*pixels.min(axis=0), *(size - pixels.max(axis=0))) < 1.5


def test_what_is_behind_the_camera_has_no_place_in_its_picture():
    camera = Camera((0.0, 0.0, 0.0), 2.0, 90.0, 0.0)  # at y = -2, looking along y
    pixels = camera.pixels(np.array([[0.0, -2.5, 0.0], [0.0, -1.0, 0.0]]), 40, 20)
    assert np.isnan(pixels[0]).all()
    np.testing.assert_allclose(pixels[1], [20.0, 10.0])


def test_places_are_where_mujoco_draws_them(ladder):
    """A gold ball in an empty corner of the cabin: the middle of its pixels."""
    with gl_or_skip():
        renderer = SceneRenderer(ladder, robot_spec("mlivr2"), 320, 160)
    camera = Camera((0.5, 0.1, 0.8), 5.0, 70.0, -12.0)
    away = (np.array([0.0, 0.0, -5.0]), np.array([1.0, 0, 0, 0]), np.zeros((2, 6)))
    empty = renderer.render(*away, camera=camera).astype(int)
    for place in ((0.5, 0.1, 0.8), (1.3, 0.6, 1.2), (-0.4, -0.5, 0.4)):
        far = np.array([[0.0, 0.0, -9.0]])
        ball = Route(far, far[:0], np.array(place), 0.1, ())
        seen = renderer.render(*away, camera=camera, route=ball).astype(int)
        rows, columns = np.nonzero(np.abs(seen - empty).sum(axis=2) > 20)
        (expected,) = camera.pixels(np.array([place]), 320, 160)
        np.testing.assert_allclose([columns.mean() + 0.5, rows.mean() + 0.5], expected, atol=1.5)
    renderer.close()


def test_a_renderer_that_is_dropped_releases_its_context(ladder):
    """It holds 160 MB, and an environment that made pictures need not be closed."""
    with gl_or_skip():
        renderer = SceneRenderer(ladder, robot_spec("mlivr2"), 32, 16)
    context = weakref.ref(renderer._renderer)
    assert context() is not None
    del renderer
    gc.collect()
    assert context() is None


LEFT = Box.between("left", "obstacle", (1.2, -0.9, -0.3), (1.8, -0.5, 0.3))
RIGHT = Box.between("right", "obstacle", (5.6, -0.9, -0.3), (6.2, -0.5, 0.3))


def test_obstacles_are_drawn_where_they_are_and_only_while_they_are_there():
    painter = MlivrEnv(render_mode="rgb_array", width=160, height=90)
    painter.reset(options={"start": ("D2a:4", "D2b:4"), "goal": (6.0, 0.0, 0.42)})
    with gl_or_skip():
        empty = painter.render().astype(int)
    middle = []
    for box in (LEFT, RIGHT):
        painter.graph.add_obstacles([box])
        picture = painter.render().astype(int)
        painter.graph.remove_obstacles()
        # Their colour, where it was not before; what else has changed are their shadows.
        orange, before = (seen[..., 0] > seen[..., 2] + 40 for seen in (picture, empty))
        rows, columns = np.nonzero(orange & ~before)
        assert len(rows) > 50
        middle.append(columns.mean())
    assert abs(middle[0] - middle[1]) > 60
    assert (middle[0] - 80) * (middle[1] - 80) < 0
    np.testing.assert_array_equal(painter.render(), empty)
    painter.close()


def test_the_window_shows_the_present_obstacles(monkeypatch):
    """MuJoCo's viewer stands in for the screen: what it is given must hold the boxes."""
    mujoco_viewer = pytest.importorskip("mujoco.viewer")
    opened, viewer = [], Mock()

    def launch(model, data):
        opened.append({model.geom(k).name for k in range(model.ngeom)})
        return viewer

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(mujoco_viewer, "launch_passive", launch)
    env = MlivrEnv(render_mode="human")
    env.graph.add_obstacles([LEFT])
    _, info = env.reset(seed=0)
    env.step(int(np.flatnonzero(info["action_mask"])[0]))
    assert (len(opened), viewer.close.call_count) == (1, 0)
    env.graph.add_obstacles([RIGHT])
    env.render()
    assert viewer.close.call_count == 1
    env.graph.remove_obstacles()
    env.render()
    assert viewer.close.call_count == 2
    boxes = {"box/left", "box/right"}
    assert [boxes & seen for seen in opened] == [{"box/left"}, boxes, set()]


def geoms(scene, kind):
    return [geom for geom in scene.geoms[: scene.ngeom] if geom.type == kind]


def scene_of(graph, most=2000):
    return mujoco.MjvScene(compile_spec(scene_spec(graph.grasp_map, graph.robot)), most)


def test_the_base_path_is_the_one_that_is_walked(checked_graph, plan):
    """The trajectory that is executed is on it, from stance to stance."""
    for k, found in enumerate(base_paths(plan)):
        np.testing.assert_allclose(found[[0, -1]], plan.motion.base_positions[k : k + 2], atol=1e-6)
        walked = step_trajectory(checked_graph, plan, k, Durations(), 0.1).base_positions
        away = np.linalg.norm(walked[:, None] - found[None], axis=2).min(axis=1)
        assert away.max() < 0.6 * np.linalg.norm(np.diff(found, axis=0), axis=1).max()


def test_path_goal_and_footholds_are_in_the_scene(checked_graph, plan):
    scene = scene_of(checked_graph)
    Route.of(checked_graph.grasp_map, plan).add_to(scene)
    tubes = geoms(scene, mujoco.mjtGeom.mjGEOM_CAPSULE)
    balls = geoms(scene, mujoco.mjtGeom.mjGEOM_SPHERE)
    ends = []
    for tube in tubes:
        np.testing.assert_allclose(tube.rgba, rgba(BASE_COLOUR), atol=1e-6)
        assert tube.size[0] == pytest.approx(PATH_RADIUS)
        half = tube.size[2] * tube.mat[:, 2]
        ends += [tube.pos - half, tube.pos + half]
    line = plan_base_path(plan)
    moved = np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-9
    np.testing.assert_allclose(ends[0::2], line[:-1][moved], atol=1e-5)
    np.testing.assert_allclose(ends[1::2], line[1:][moved], atol=1e-5)
    (goal,) = (ball for ball in balls if ball.size[0] == pytest.approx(plan.query.goal_tolerance))
    np.testing.assert_allclose(goal.pos, plan.query.goal, atol=1e-6)
    assert 0.1 < goal.rgba[3] < 0.6
    for limb, points in enumerate(plan.footholds):
        colour = rgba(LIMB_COLOURS[limb])
        held = [b.pos.copy() for b in balls if np.allclose(b.rgba, colour, atol=1e-6)]
        index = [checked_graph.grasp_map.index(point) for point in points]
        np.testing.assert_allclose(held, checked_graph.grasp_map.positions[index], atol=1e-6)
    stances = [b for b in balls if np.allclose(b.rgba, rgba(BASE_COLOUR), atol=1e-6)]
    assert len(stances) == len(plan.stances)


def test_a_ghost_is_a_pale_copy_of_the_robot_alone(checked_graph, plan):
    with gl_or_skip():
        renderer = SceneRenderer(checked_graph.grasp_map, checked_graph.robot, 160, 90)
    here, there = plan.configuration(0), plan.configuration(len(plan.steps))
    alone = renderer.render(*here).astype(int)
    count = renderer._renderer.scene.ngeom
    pale = renderer.render(*here, ghosts=[there]).astype(int)
    scene = renderer._renderer.scene
    ghosts = list(scene.geoms[count : scene.ngeom])
    renderer.close()
    assert len(ghosts) > 10
    assert all(geom.rgba[3] <= GHOST_OPACITY + 1e-6 for geom in ghosts)
    reach = 2.0 * checked_graph.robot.extent
    assert all(np.linalg.norm(geom.pos - there[0]) < reach for geom in ghosts)
    assert (np.abs(pale - alone).sum(axis=2) > 10).sum() > 20


def test_physics_are_those_of_the_scene(jem):
    """Masses, joints, shapes that meet and their names; a step goes the same way."""
    robot = robot_spec("mlivr2")
    plain, lit = (make(jem, robot).compile() for make in (scene_spec, studio_spec))
    hull = [lit.geom(k).name for k in range(lit.ngeom) if lit.geom(k).name.startswith("studio/")]
    assert len(hull) == 6
    assert all(lit.geom(name).contype == lit.geom(name).conaffinity == 0 for name in hull)
    meshes = [k for k in range(lit.ngeom) if lit.geom_type[k] == mujoco.mjtGeom.mjGEOM_MESH]
    assert not (lit.geom_contype | lit.geom_conaffinity)[meshes].any()
    assert lit.ngeom == plain.ngeom + 6 + len(meshes)
    assert lit.body_mass.sum() == plain.body_mass.sum()
    ended = []
    for model in (plain, lit):
        data = mujoco.MjData(model)
        data.qpos[0], data.qvel[:] = 4.0, 0.3
        for _ in range(50):
            mujoco.mj_step(model, data)
        ended.append(data.qpos.copy())
    np.testing.assert_array_equal(*ended)
