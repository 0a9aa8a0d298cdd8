"""Measured points lie where rays meet boxes and nothing of the robot is seen."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from mlivr_gym import Box
from mlivr_gym.extensions.closed_loop.depth_camera import (
    CORNERS,
    GRIPPER_AXES,
    LENS_OFFSET,
    SIDES,
    DepthCamera,
)
from mlivr_gym.simulation.disturbances import robot_body_ids
from mlivr_gym.simulation.gl import mujoco
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
    rng = np.random.default_rng(0)
    points = camera.measure(simulation.model, simulation.data, robot, rng)
    boxes, expected, hidden, beyond = [*checked_graph.grasp_map.boxes, WALL], [], 0, 0
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
    none = DepthCamera(pixels=3, max_range=0.001)
    assert none.measure(simulation.model, simulation.data, robot, rng).shape == (0, 3)


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


@pytest.mark.parametrize("field_of_view", [0.5, 1.2, 2.4])
def test_the_outermost_pixels_lie_half_a_pixel_within_the_field_of_view(field_of_view):
    """Of a pinhole camera, whose pixels are alike on the plane of the image."""
    (rays,) = DepthCamera(pixels=20, field_of_view=field_of_view).rays(np.array([[2.0, 0.0, 0.0]]))
    side, up = rays[:, 1] / rays[:, 0], rays[:, 2] / rays[:, 0]
    centres = np.tan(0.5 * field_of_view) * (np.arange(20) - 9.5) / 10.0
    for places in (side, up):
        np.testing.assert_allclose(np.sort(places), np.repeat(centres, 20), atol=1e-12)
