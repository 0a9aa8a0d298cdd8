"""The camera is MuJoCo's, and what shall be inside a picture is."""

import numpy as np
import pytest
from gl_there import gl_or_skip

from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.rendering import SceneRenderer
from mlivr_gym.pictures.route import Route
from mlivr_gym.robot.specification import robot_spec


def surfaces(places, radius):
    rng = np.random.default_rng(1)
    around = rng.normal(size=(4000, 3))
    around *= radius / np.linalg.norm(around, axis=1, keepdims=True)
    return (places[:, None] + around).reshape(-1, 3)


@pytest.mark.parametrize("aspect", [2.0, 0.5])
def test_balls_are_inside_the_picture_and_one_touches_its_edge(aspect):
    rng = np.random.default_rng(0)
    height = 300
    width = round(aspect * height)
    for azimuth, elevation in ((84.0, -8.0), (200.0, 40.0)):
        places = rng.uniform(-1.0, 1.0, (12, 3))
        camera = Camera((0.1, -0.2, 0.3), azimuth=azimuth, elevation=elevation)
        camera = camera.seeing(places, 0.15, aspect)
        pixels = camera.pixels(surfaces(places, 0.15), width, height)
        assert pixels.min() >= 0.0
        assert (pixels <= [width, height]).all()
        margin = min(*pixels.min(axis=0), *([width, height] - pixels.max(axis=0)))
        assert margin < 1.5


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
