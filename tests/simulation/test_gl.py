"""A wrong `MUJOCO_GL` is one line, and what renders nothing goes on."""

import json
import os
import subprocess
import sys

import pytest

from mlivr_gym.planners import Planner

INTERRUPTED = """
import mujoco
from mlivr_gym import GraspMap, robot_spec
from mlivr_gym.pictures.rendering import SceneRenderer

def interrupt(*_):
    raise KeyboardInterrupt

mujoco.MjrContext = interrupt
SceneRenderer(GraspMap.load("map.json"), robot_spec("mlivr2"))
"""


def run(folder, backend, *arguments):
    environment = os.environ | {"MUJOCO_GL": backend}
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory, small_graph):
    folder, graph = tmp_path_factory.mktemp("gl"), small_graph
    (folder / "map.json").write_text(json.dumps(graph.grasp_map.to_dict()))
    plan = Planner(graph).plan(graph.ids(graph.points[0]), graph.base_position[-1]).unwrap()
    plan.save(folder / "plan.json")
    return folder


def test_a_command_tells_it_in_one_line(folder):
    words = "simulate --map map.json --plan plan.json --out w"
    done = run(folder, "foo", "-m", "mlivr_gym", *words.split())
    assert done.returncode in (0, 1), done.stderr  # steps of this plan were not checked
    told = [line for line in (done.stdout + done.stderr).splitlines() if "MUJOCO_GL" in line]
    assert len(told) == 1
    assert "cannot render with MUJOCO_GL='foo'" in told[0]
    assert "set MUJOCO_GL to 'egl', 'osmesa' or 'glfw'" in told[0]
    assert "Traceback" not in done.stderr
    assert (folder / "w" / "simulation.npz").exists()


def test_an_interruption_while_a_context_opens_leaves_one_traceback(folder):
    """The context is released before EGL is closed, so that nothing else is printed at exit."""
    done = run(folder, "egl", "-c", INTERRUPTED)
    if "cannot render with MUJOCO_GL" in done.stderr:
        pytest.skip("no EGL")
    assert done.stderr.splitlines()[-1] == "KeyboardInterrupt"
    assert done.stderr.count("Traceback") == 1
