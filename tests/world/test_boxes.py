"""Boxes from files, of point clouds and of capsules stand where they should, and cover these."""

import json

import coal
import mujoco
import numpy as np
import pytest
from compiled import called
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from map_data import POINT
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, GraspMap, robot_spec
from mlivr_gym.collisions.against_boxes import GraspSurface, compare_with_grid
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.distances import CLEAR, OBSTACLE
from mlivr_gym.errors import ShapeError
from mlivr_gym.simulation.scene import scene_spec
from mlivr_gym.world.boxes import load_obstacles
from mlivr_gym.world.covering_boxes import capsule_box, point_cloud_boxes

ROBOT = robot_spec("mlivr2")
vectors = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)
halves = st.lists(st.floats(0.05, 0.5), min_size=3, max_size=3).map(np.array)
FLOOR = GraspMap.from_dict({"points": [POINT]})


@given(vectors.map(lambda at: at.round(6)), halves, vectors, vectors)
@examples(max_examples=60, deadline=None)
def test_a_box_is_what_it_was_after_a_file(tmp_path_factory, centre, half, turn, point):
    """Its fields, where MuJoCo puts it, and which points the compiled check finds in it.

    It stands at whole micrometres, since MuJoCo takes less for nothing.
    """
    rotation = Rotation.from_rotvec(turn).as_matrix()
    box = Box("crate", "obstacle", tuple(centre), tuple(half), Box.rows(rotation))
    path = tmp_path_factory.getbasetemp() / "crate.json"
    path.write_text(json.dumps({"boxes": [box.to_dict()]}))
    (loaded,), _ = load_obstacles(path)
    assert loaded == box
    assert Box.from_dict(box.to_dict()) == box
    np.testing.assert_allclose(loaded.rotation, rotation, atol=1e-15)
    model = scene_spec(FLOOR, ROBOT, (loaded,)).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom = model.geom("box/crate").id
    np.testing.assert_allclose(data.geom_xmat[geom].reshape(3, 3), rotation, atol=1e-7)
    np.testing.assert_allclose(data.geom_xpos[geom], centre, atol=1e-12)
    # A speck at a place in the box's axes, inside or outside.
    local = 1.2 * half * np.clip(point, -1.0, 1.0)
    inside = bool((np.abs(local) < half).all())
    place, still = tuple(centre + rotation @ local), (0.0, 0.0)
    grid, nothing = box_grid((loaded,)), GraspSurface.row()
    answer = called(compare_with_grid)((place, place), 1e-9, still, grid, nothing, False)
    assert answer == (OBSTACLE if inside else CLEAR)


def test_obstacles_are_read_and_faulty_files_named(tmp_path):
    box = Box.between("crate", "obstacle", (0, 0, 0), (1, 1, 1))
    path = tmp_path / "obstacles.json"
    path.write_text(json.dumps({"boxes": [box.to_dict()], "occupied": ["D3a:4"]}))
    assert load_obstacles(path) == ((box,), ("D3a:4",))
    for text in ("[]", "{", '{"boxes": [], "things": 1}', '{"occupied": [3]}'):
        path.write_text(text)
        with pytest.raises(ShapeError, match=r"obstacles\.json"):
            load_obstacles(path)


SEEDS = st.integers(0, 2**32 - 1)


def drawn_inside(boxes, count, rng):
    """Random points of boxes."""
    chosen = [boxes[k] for k in rng.integers(len(boxes), size=count)]
    local = [np.array(box.half) * rng.uniform(-1.0, 1.0, 3) for box in chosen]
    return np.array([
        np.array(box.centre) + np.array(box.rotation) @ point
        for box, point in zip(chosen, local, strict=True)
    ])  # fmt: skip


@given(SEEDS, st.integers(1, 400), st.sampled_from([0.02, 0.05, 0.3]))
def test_each_point_lies_in_a_box_and_no_box_is_far_from_the_points(seed, count, resolution):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.0, 1.0, (count, 3)) * rng.uniform(0.05, 0.5, 3) + rng.normal(size=3)
    boxes = point_cloud_boxes(points, resolution)
    centres, halves = (np.array([getattr(box, k) for box in boxes]) for k in ("centre", "half"))
    inside = (np.abs(points[:, None] - centres) <= halves + 1e-9).all(axis=2)
    assert inside.any(axis=1).all()
    away, _ = cKDTree(points).query(drawn_inside(boxes, 200, rng))
    assert away.max() <= np.sqrt(3.0) * resolution + 1e-9
    assert len({box.id for box in boxes}) == len(boxes)
    # Each cube with a point lies in one box alone.
    cubes = len(np.unique(np.floor(points / resolution), axis=0))
    np.testing.assert_allclose(np.prod(2.0 * halves, axis=1).sum(), cubes * resolution**3)


@pytest.mark.parametrize("cubes", [128, 257, 65_536])
def test_a_long_row_of_cubes_is_one_box_for_each_gap(cubes):
    """Both ends of the row are there, so that the numbers of the cubes reach the last one."""
    gaps = np.array([cubes // 3, cubes - 2])
    cells = np.delete(np.arange(cubes), gaps)
    points = np.column_stack([np.zeros((cubes - 2, 2)), 0.01 * (cells + 0.5) - 300.0])
    for turn in range(3):
        boxes = point_cloud_boxes(np.roll(points, turn, axis=1), 0.01)
        bounds = np.array([box.bounds for box in boxes])[:, :, (2 + turn) % 3]
        ends = [[0, gaps[0]], [gaps[0] + 1, gaps[1]], [cubes - 1, cubes]]
        np.testing.assert_allclose(bounds, 0.01 * np.array(ends) - 300.0, atol=1e-9)


@given(SEEDS, st.floats(0.01, 0.4), st.booleans())
def test_a_box_covers_its_capsule_and_little_more(seed, radius, is_ball):
    """The distances from another shape are those of another library."""
    rng = np.random.default_rng(seed)
    start = rng.normal(size=3)
    end = start if is_ball else start + rng.normal(size=3)
    box = capsule_box("strut", start, end, radius)
    length = np.linalg.norm(end - start)
    frame = coal.Transform3s(np.array(box.rotation), np.array(box.centre))
    solid = coal.Box(*(2.0 * np.array(box.half)))
    # A capsule of coal lies along z.
    turned = np.array(box.rotation)[:, [1, 2, 0]]
    capsule = coal.Capsule(radius, length)
    ball = coal.Sphere(0.05)
    for centre in start + 2.0 * rng.normal(size=(20, 3)):
        at = coal.Transform3s(np.eye(3), centre)
        to_box, to_capsule = (
            coal.distance(shape, where, ball, at, coal.DistanceRequest(), coal.DistanceResult())
            for shape, where in (
                (solid, frame), (capsule, coal.Transform3s(turned, np.array(box.centre))),
            )
        )  # fmt: skip
        if to_box > 0.0:
            assert to_capsule - (np.sqrt(3.0) - 1.0) * radius - 1e-6 <= to_box <= to_capsule + 1e-6


@given(SEEDS, st.integers(1, 20))
def test_boxes_made_at_once_are_those_made_one_by_one(seed, count):
    rng = np.random.default_rng(seed)
    low = rng.normal(size=(count, 3))
    high = low + rng.uniform(1e-3, 1.0, (count, 3))
    each = Box.each_between("box", "obstacle", low, high)
    ends = enumerate(zip(low.tolist(), high.tolist(), strict=True))
    assert each == tuple(Box.between(f"box{k}", "obstacle", *one) for k, one in ends)
    assert len(set(each)) == count


def test_no_points_are_no_boxes():
    assert point_cloud_boxes(np.zeros((0, 3))) == ()
