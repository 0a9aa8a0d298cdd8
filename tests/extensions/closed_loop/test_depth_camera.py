"""Measured points lie where rays meet boxes and nothing of the robot is seen."""

from contextlib import contextmanager
from copy import copy

import numpy as np
import pytest
from gl_there import gl_or_skip
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from mlivr_gym import Box
from mlivr_gym.extensions.closed_loop.depth_camera import (
    CORNERS,
    GRIPPER_AXES,
    LENS_OFFSET,
    SIDES,
    DepthCamera,
)
from mlivr_gym.simulation.disturbances import robot_body_ids
from mlivr_gym.simulation.gl import mujoco, render_error
from mlivr_gym.simulation.setup import Setup

WALL = Box.between("wall", "obstacle", (3.2, -1.0, -1.0), (3.5, 1.0, 0.3))


@pytest.fixture(scope="module")
def simulation(checked_graph, plan):
    simulation = Setup().simulation(checked_graph.grasp_map, checked_graph.robot, [WALL])
    motion = plan.motion
    points = [checked_graph.grasp_map.index(point) for point in plan.stances[0]]
    simulation.reset(
        motion.base_positions[0], motion.base_quaternions[0], motion.joint_positions[0], points
    )
    return simulation


def first_hit(origin, direction, boxes):
    """Distance along a ray to the nearest box, by slabs (Kay and Kajiya 1986)."""
    nearest = np.inf
    for box in boxes:
        rotation = np.array(box.rotation)
        o, d = (origin - np.array(box.centre)) @ rotation, direction @ rotation
        with np.errstate(divide="ignore"):
            slabs = np.sort([(-np.array(box.half) - o) / d, (np.array(box.half) - o) / d], axis=0)
        enter, leave = slabs[0].max(), slabs[1].min()
        if enter <= leave and enter > 0.0:
            nearest = min(nearest, enter)
    return nearest


def lenses_of(simulation, robot):
    """Yield position, orientation and optical axis (in its own frame) of each camera."""
    base = simulation.data.body("base")
    rotation = base.xmat.reshape(3, 3)
    for corner in CORNERS:
        lens = corner * (0.5 * np.array(robot.body_edges) + LENS_OFFSET)
        yield base.xpos + rotation @ lens, rotation, corner
    for limb in range(robot.limbs):
        tool = simulation.data.body(f"limb{limb}/wrist_3")
        turn = tool.xmat.reshape(3, 3)
        for side, axis in zip(SIDES, GRIPPER_AXES, strict=True):
            # The last link and the gripper of a UR5e lie within 40 mm of the axis of the flange.
            yield tool.xpos + turn @ ((0.04 + LENS_OFFSET) * side), turn, axis


def with_origins(camera, simulation, robot):
    """The hits of cameras without noise, and where each was seen from: on whose ray it lies."""
    args = simulation.model, simulation.data, robot, np.random.default_rng(0)
    hits = camera.measure(*args)
    origins, rest = np.full_like(hits, np.nan), np.arange(len(hits))
    for origin, turn, axis in lenses_of(simulation, robot):  # in this order they are measured
        tree = KDTree(camera.rays(axis[None])[0] @ turn.T)
        away = hits[rest] - origin
        off, _ = tree.query(away / np.linalg.norm(away, axis=1, keepdims=True))
        count = int(np.argmax(np.append(off, 1.0) > 1e-7))
        origins[rest[:count]], rest = origin, rest[count:]
    assert not len(rest)
    return hits, origins


def meets_the_robot(simulation, origin, ray):
    """Whether a ray first meets a part of the robot."""
    model, geom = simulation.model, np.zeros(1, dtype=np.int32)
    mujoco.mj_ray(model, simulation.data, origin, ray, None, 1, -1, geom)
    return model.geom_bodyid[geom[0]] in robot_body_ids(model)


@pytest.mark.parametrize("max_range", [0.6, 1.2, 3.0])
def test_points_lie_where_rays_first_meet_a_box(simulation, checked_graph, max_range):
    """As far as the range goes, and no farther, although there are surfaces just beyond."""
    camera, robot = DepthCamera(pixels=6, noise=0.0, max_range=max_range), checked_graph.robot
    points = camera.measure(simulation.model, simulation.data, robot, np.random.default_rng(0))
    boxes, expected, hidden = [*checked_graph.grasp_map.boxes, WALL], [], 0
    beyond = 0
    for origin, turn, axis in lenses_of(simulation, robot):
        for ray in camera.rays(axis[None])[0] @ turn.T:
            distance = first_hit(origin, ray, boxes)
            if distance <= max_range:
                expected.append(origin + distance * ray)
                hidden += meets_the_robot(simulation, origin, ray)
            elif distance <= 1.05 * max_range:
                beyond += not meets_the_robot(simulation, origin, ray)
    expected = np.array(expected)
    away = np.linalg.norm(points[:, None] - expected, axis=2)
    assert away.min(axis=1).max() < 1e-9  # each point is a first hit
    assert len(points) == len(expected) - hidden
    assert hidden
    assert beyond or max_range == 3.0


@pytest.mark.parametrize(("share", "is_seen"), [(0.98, True), (1.02, False)])
def test_a_small_thing_is_seen_up_to_the_range(simulation, checked_graph, share, is_seen):
    """A cube of 1 cm in the middle of a ray that meets nothing else that near."""
    robot, reach = checked_graph.robot, 0.5
    camera = DepthCamera(pixels=6, noise=0.0, max_range=reach)
    boxes = [*checked_graph.grasp_map.boxes, WALL]
    origin, ray = next(
        (origin, ray)
        for origin, turn, axis in lenses_of(simulation, robot)
        for ray in camera.rays(axis[None])[0] @ turn.T
        if first_hit(origin, ray, boxes) > 2.0 * reach
        and not meets_the_robot(simulation, origin, ray)
    )
    place = origin + (share * reach + 0.005) * ray
    turn = Rotation.align_vectors([ray], [[1.0, 0.0, 0.0]])[0].as_matrix()
    cube = Box("cube", "obstacle", tuple(place), (0.005,) * 3, tuple(map(tuple, turn)))
    other = Setup().simulation(checked_graph.grasp_map, robot, [cube])
    other.data.qpos[:] = simulation.data.qpos
    mujoco.mj_forward(other.model, other.data)
    hits = camera.measure(other.model, other.data, robot, np.random.default_rng(0))
    nearest = np.linalg.norm(hits - (origin + share * reach * ray), axis=1).min()
    assert (nearest < 1e-9) == is_seen
    assert is_seen or nearest > 0.01


@contextmanager
def rendering(model, pixels):
    """A renderer by which nothing is too near; where it cannot be had, a `RenderError`."""
    model = copy(model)
    model.vis.map.znear, model.vis.quality.offsamples = 0.002 / model.stat.extent, 0
    try:
        renderer = mujoco.Renderer(model, pixels, pixels)
    except Exception as error:
        raise render_error(error) from None
    with renderer:
        yield renderer


def aim(renderer, origin, axes, half_width):
    """Set the cameras of a scene by hand, as the model has none there."""
    near = renderer.model.vis.map.znear * renderer.model.stat.extent
    for camera in renderer.scene.camera:
        camera.pos, camera.forward, camera.up = origin, axes[0], -axes[2]
        camera.frustum_near, camera.frustum_center = near, 0.0
        camera.frustum_width = camera.frustum_top = near * half_width
        camera.frustum_bottom = -near * half_width


def test_the_hits_are_those_of_rendered_depth_images(simulation, checked_graph):
    """OpenGL draws the depth and the shape in each pixel of the same cameras."""
    camera, robot, n = DepthCamera(pixels=60, noise=0.0), checked_graph.robot, 60
    model, data, half = simulation.model, simulation.data, np.tan(0.5 * camera.field_of_view)
    hits, origins = with_origins(camera, simulation, robot)
    of_robot = np.isin(model.geom_bodyid, robot_body_ids(model))
    errors, seen = [], 0
    with gl_or_skip(), rendering(model, n) as renderer:
        option = mujoco.MjvOption()
        option.geomgroup[:], option.sitegroup[:] = 1, 0  # marks are not there for rays
        for origin, turn, axis in lenses_of(simulation, robot):
            right = np.cross(axis, (0.0, 0.0, 1.0))
            axes = np.array([axis, right, np.cross(axis, right)]) @ turn.T
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
            images = []
            for kind in ("depth", "segmentation"):
                getattr(renderer, f"enable_{kind}_rendering")()
                renderer.update_scene(data, scene_option=option)
                aim(renderer, origin, axes, half)
                images.append(renderer.render().copy())
                getattr(renderer, f"disable_{kind}_rendering")()
            depths, geoms = images[0], images[1][..., 0]
            chosen = np.linalg.norm(origins - origin, axis=1) < 1e-6
            depth, u, v = axes @ (hits[chosen] - origin).T
            places = (np.array([u, v]) / depth / half + 1.0) * 0.5 * n - 0.5
            column, row = np.round(places).astype(int)
            errors += np.abs(depths[row, column] - depth).tolist()
            centres = ((np.arange(n) + 0.5) / n * 2.0 - 1.0) * half
            distances = depths * np.sqrt(1.0 + centres**2 + centres[:, None] ** 2)
            seen += np.sum(~of_robot[geoms] & (geoms >= 0) & (distances <= camera.max_range))
    assert len(errors) == len(hits) == pytest.approx(seen, rel=1e-3)
    assert np.mean(np.array(errors) > 1e-4) < 1e-3  # pixels at edges


def test_noise_is_along_the_rays_and_as_large_as_stated(simulation, checked_graph):
    robot = checked_graph.robot
    exact, origins = with_origins(DepthCamera(noise=0.0), simulation, robot)
    noisy = DepthCamera(noise=0.01).measure(
        simulation.model, simulation.data, robot, np.random.default_rng(0)
    )
    rays = (exact - origins) / np.linalg.norm(exact - origins, axis=1, keepdims=True)
    error = np.einsum("ij,ij->i", noisy - exact, rays)
    assert np.linalg.norm(np.cross(exact - origins, noisy - origins), axis=1).max() < 1e-9
    assert len(error) > 40_000
    assert error.std() == pytest.approx(0.01, rel=0.01)
    assert error.mean() == pytest.approx(0.0, abs=2e-4)


def test_the_images_cover_all_directions():
    camera = DepthCamera(pixels=40)
    rays = camera.rays().reshape(-1, 3)
    assert np.linalg.norm(rays, axis=1) == pytest.approx(np.ones(len(rays)))
    drawn = np.random.default_rng(1).normal(size=(500, 3))
    drawn /= np.linalg.norm(drawn, axis=1, keepdims=True)
    nearest = np.arccos(np.clip(drawn @ rays.T, -1.0, 1.0)).min(axis=1)
    # Half the diagonal of a pixel at the middle of an image, where it covers the largest angle.
    pixel = 2.0 * np.tan(0.5 * camera.field_of_view) / camera.pixels
    assert nearest.max() < np.arctan(pixel / np.sqrt(2.0))
    narrow = DepthCamera(pixels=40, field_of_view=1.2).rays().reshape(-1, 3)
    missed = np.arccos(np.clip(drawn @ narrow.T, -1.0, 1.0)).min(axis=1)
    assert missed.max() > 3.0 * nearest.max()


@pytest.mark.parametrize("field_of_view", [0.5, 1.2, 2.4])
def test_the_outermost_pixels_lie_half_a_pixel_within_the_field_of_view(field_of_view):
    """Of a pinhole camera, whose pixels are alike on the plane of the image."""
    (rays,) = DepthCamera(pixels=20, field_of_view=field_of_view).rays(np.array([[2.0, 0.0, 0.0]]))
    side, up = rays[:, 1] / rays[:, 0], rays[:, 2] / rays[:, 0]
    centres = np.tan(0.5 * field_of_view) * (np.arange(20) - 9.5) / 10.0
    for places in (side, up):
        np.testing.assert_allclose(np.sort(places), np.repeat(centres, 20), atol=1e-12)


def test_a_ray_that_hits_nothing_within_the_range_gives_no_point(simulation, checked_graph):
    given = simulation.model, simulation.data, checked_graph.robot, np.random.default_rng(0)
    assert DepthCamera(pixels=3, max_range=0.001).measure(*given).shape == (0, 3)
