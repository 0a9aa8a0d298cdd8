"""What a scene holds of a plan: base path, goal, footholds; and what is pale."""

import mujoco
import numpy as np
import pytest
from gl_there import gl_or_skip

from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.pictures.figures import BASE_COLOUR
from mlivr_gym.pictures.rendering import GHOST_OPACITY, SceneRenderer
from mlivr_gym.pictures.route import PATH_RADIUS, Route, base_paths, plan_base_path
from mlivr_gym.robot.visuals import LIMB_COLOURS
from mlivr_gym.simulation.scene import compile_spec, rgba, scene_spec
from mlivr_gym.simulation.timing import step_trajectory


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
