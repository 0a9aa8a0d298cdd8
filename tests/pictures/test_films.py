"""A film keeps the robot in its pictures, and says when and what it does."""

from dataclasses import replace

import numpy as np
import pytest
from gl_there import gl_or_skip
from PIL import Image
from recordings import resting

from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.errors import RenderError
from mlivr_gym.pictures.captions import strip_height
from mlivr_gym.pictures.films import (
    default_speed,
    film,
    film_cameras,
    film_samples,
)
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.timing import plan_trajectory

SIZE = (320, 160)


@pytest.fixture(scope="module")
def walk(checked_graph):
    """The walk of Case 3 to the overhead, and a recording of it as if it went as planned."""
    planner = Planner(checked_graph)
    plan = planner.plan(
        ("D1b:4", "D2a:3"), (6.3, 0.5, 0.35), "steps", goal_face="overhead"
    ).unwrap()
    planned = plan_trajectory(checked_graph, plan, period=0.5)
    recording = replace(
        resting(len(planned.times), checked_graph.robot.limbs),
        times=planned.times,
        step=planned.step,
        phase=planned.phase,
        joint_positions=planned.joint_positions,
        base_positions=planned.base_positions,
        base_quaternions=planned.base_quaternions,
    )
    return plan, recording


def shown(recording, stride=7):
    return [
        (recording.base_positions[k], recording.base_quaternions[k], recording.joint_positions[k])
        for k in range(0, len(recording.times), stride)
    ]


def test_every_shape_of_the_robot_is_in_every_picture(checked_graph, walk):
    """Grippers at the overhead and on the deck included; the camera goes along."""
    robot, shapes = checked_graph.robot, LimbShapes(checked_graph.robot)
    configurations = shown(walk[1])
    cameras = film_cameras(robot, configurations, 2.0)
    margin = []
    for configuration, camera in zip(configurations, cameras, strict=True):
        ends = capsule_ends(robot, shapes, configuration)
        for axis in (0, 1, 2):
            off = np.eye(3)[axis] * shapes.radii[:, None, None]
            for places in (ends + off, ends - off):
                pixels = camera.pixels(places.reshape(-1, 3), *SIZE)
                margin.append(min(pixels.min(), *(np.array(SIZE) - pixels.max(axis=0))))
    assert min(margin) > 0.0
    assert min(margin) < 12.0  # nor is it farther away than that needs
    assert len({camera.distance for camera in cameras}) == 1
    for (base, _, _), camera in zip(configurations, cameras, strict=True):
        assert camera.lookat == (base[0], *cameras[0].lookat[1:])


def test_a_film_runs_as_much_faster_than_the_clock_as_it_says(walk):
    recording = walk[1]
    usual, duration = default_speed(recording), float(recording.times[-1])
    assert duration / usual <= 8.0 < 2.0 * duration / usual
    for speed in (usual, 32.0, 200.0):
        shown_at = recording.times[film_samples(recording, speed)]
        assert shown_at[0] == 0.0
        assert shown_at[-1] == duration
        # Samples are half a second apart here, so that one is shown that much late at most.
        wanted = np.arange(len(shown_at) - 1) * speed / 10
        assert (np.abs(shown_at[:-1] - wanted) <= 0.5).all()
    with pytest.raises(RenderError, match="frames, more than 5000; choose a higher speed"):
        film_samples(recording, 10.0 * duration / 5001)
    assert len(film_samples(recording, 10.0 * duration / 4998)) <= 5000


def test_a_film_has_the_size_asked_for_and_the_path_in_it(checked_graph, walk, tmp_path):
    plan, recording = walk
    path, plain = tmp_path / "walk.gif", tmp_path / "plain.gif"
    duration = float(recording.times[-1])
    speed = duration / 0.3
    with gl_or_skip():
        film(checked_graph.grasp_map, checked_graph.robot, recording, path, plan=plan, size=SIZE,
             speed=speed)  # fmt: skip
    film(checked_graph.grasp_map, checked_graph.robot, recording, plain, size=SIZE, speed=speed)
    pictures = []
    for file in (path, plain):
        with Image.open(file) as opened:
            assert opened.size == SIZE
            lasting = []
            for k in range(opened.n_frames):
                opened.seek(k)
                lasting.append(opened.info["duration"])
            # The time of the film at its speed, and a second for the last picture.
            assert 1e-3 * sum(lasting) == pytest.approx(duration / speed + 1.0, abs=0.11)
            assert min(lasting) == 100
            opened.seek(1)
            pictures.append(np.asarray(opened.convert("RGB")).astype(int))
    counts = []
    for picture in pictures:
        red, green, blue = np.moveaxis(picture[: 160 - strip_height(160)], 2, 0)
        counts.append(int(((green > red + 30) & (green > blue + 30)).sum()))
    assert counts[0] > 50  # the base path is green
    assert counts[1] == 0
