"""Boxes from files stand where they should, and faulty ones are named."""

import json

import mujoco
import numpy as np
import pytest
from compiled import called
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, GraspMap, robot_spec
from mlivr_gym.collisions.against_boxes import GraspSurface, compare_with_grid
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.distances import CLEAR, OBSTACLE
from mlivr_gym.errors import ShapeError
from mlivr_gym.simulation.scene import scene_spec
from mlivr_gym.world.boxes import load_obstacles

ROBOT = robot_spec("mlivr2")


vectors = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


halves = st.lists(st.floats(0.05, 0.5), min_size=3, max_size=3).map(np.array)


FLOOR = GraspMap.from_dict(
    {
        "segments": [
            {
                "id": "R",
                "face": "deck",
                "start": [-0.4, 0, 0],
                "end": [0.4, 0, 0],
                "normal": [0, 0, 1],
            }
        ]
    }
)


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
