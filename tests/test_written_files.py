"""Each function that writes a file writes through links and pipes, and keeps a private file so."""

import os
import stat
import threading

import numpy as np
import pytest

from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.trajectory_files import save_csv, save_npz, save_ros
from mlivr_gym.pictures.figures import new_figure, save_figure, save_image
from mlivr_gym.pictures.films import save_film
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.simulation.timing import step_trajectory

PICTURE = np.arange(16 * 16 * 3, dtype=np.uint8).reshape(16, 16, 3)

WRITERS = {
    "map.json": lambda path, given: given["map"].save(path),
    "robot.json": lambda path, given: robot_spec("mlivr2").save(path),
    "robot.xml": lambda path, given: robot_spec("mlivr2").to_mjcf(path),
    "robot.urdf": lambda path, given: robot_spec("mlivr2").to_urdf(path),
    "plan.json": lambda path, given: given["plan"].save(path),
    "walk.csv": lambda path, given: save_csv(given["trajectory"], path),
    "walk.npz": lambda path, given: save_npz(given["trajectory"], path),
    "walk.yaml": lambda path, given: save_ros(given["trajectory"], path),
    "figure.png": lambda path, given: save_figure(new_figure(1, 1), path),
    "figure.svg": lambda path, given: save_figure(new_figure(1, 1), path),
    "picture.png": lambda path, given: save_image(PICTURE, path),
    "film.gif": lambda path, given: save_film([PICTURE, PICTURE // 2], path),
}
"""Functions that write, by the name of a file."""


@pytest.fixture(scope="module")
def given(jem, walk, checked_graph):
    trajectory = step_trajectory(checked_graph, walk, 0, Durations(), period=5.0)
    return {"map": jem, "plan": walk, "trajectory": trajectory}


@pytest.mark.parametrize("name", WRITERS)
def test_a_writer_takes_any_kind_of_file(tmp_path, given, name):
    write, folders = WRITERS[name], [tmp_path / kind for kind in ("plain", "linked", "pipe")]
    for folder in folders:
        folder.mkdir()
    plain, linked, pipe = (folder / name for folder in folders)
    write(plain, given)
    private, content, got = tmp_path / "private", plain.read_bytes(), []
    private.touch(mode=0o600)
    linked.symlink_to(private)
    write(linked, given)
    assert linked.is_symlink()
    assert private.read_bytes() == content
    assert stat.S_IMODE(private.stat().st_mode) == 0o600
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()), daemon=True)
    reader.start()
    write(pipe, given)
    reader.join(60)
    assert got == [content]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    names = [sorted(one.name for one in folder.iterdir()) for folder in folders]
    assert names[0] == names[1] == names[2]
