"""What the environment draws: the obstacles that are there now."""

import numpy as np
import pytest
from gl_there import gl_or_skip

from mlivr_gym import Box
from mlivr_gym.envs.env import MlivrEnv

LEFT = Box.between("left", "obstacle", (1.2, -0.9, -0.3), (1.8, -0.5, 0.3))
RIGHT = Box.between("right", "obstacle", (5.6, -0.9, -0.3), (6.2, -0.5, 0.3))


@pytest.fixture(scope="module")
def painter():
    env = MlivrEnv(render_mode="rgb_array", width=160, height=90)
    env.reset(options={"start": ("D2a:4", "D2b:4"), "goal": (6.0, 0.0, 0.42)})
    with gl_or_skip():
        env.render()
    yield env
    env.close()


def test_obstacles_are_drawn_where_they_are_and_only_while_they_are_there(painter):
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


def test_the_window_shows_the_present_obstacles(monkeypatch):
    """MuJoCo's viewer stands in for the screen: what it is given must hold the boxes."""
    mujoco_viewer = pytest.importorskip("mujoco.viewer")
    opened, closed = [], []

    class Viewer:
        def __init__(self, model, data):
            opened.append([model.geom(k).name for k in range(model.ngeom)])

        def sync(self):
            pass

        def close(self):
            closed.append(len(opened))

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(mujoco_viewer, "launch_passive", Viewer)
    env = MlivrEnv(render_mode="human")
    env.graph.add_obstacles([LEFT])
    _, info = env.reset(seed=0)
    assert len(opened) == 1
    assert "box/left" in opened[0]
    assert not closed
    env.step(int(np.flatnonzero(info["action_mask"])[0]))
    assert len(opened) == 1
    env.graph.add_obstacles([RIGHT])
    env.render()
    assert closed == [1]
    assert {"box/left", "box/right"} <= set(opened[1])
    env.graph.remove_obstacles()
    env.render()
    assert closed == [1, 2]
    assert not {"box/left", "box/right"} & set(opened[2])
