"""What an environment shows: stills, films, and how the robot moves in them."""

import itertools
import sys
from pathlib import Path
from types import ModuleType
from typing import ClassVar

import gymnasium
import mujoco
import numpy as np
import pytest
from gl_there import gl_or_skip
from gymnasium.utils.passive_env_checker import env_render_passive_checker

from mlivr_gym.envs.snapshots import snapshot_frames
from mlivr_gym.envs.wrappers import RecordVideo
from mlivr_gym.simulation.scene import scene_spec, set_configuration

SIZE = {"width": 160, "height": 120}


def made(mode, **settings):
    """An environment that renders small pictures; skips where there is no GL library."""
    environment = gymnasium.make("MLIVR-JEM-v0", render_mode=mode, **SIZE, **settings)
    environment.reset(seed=3)
    with gl_or_skip():
        environment.render()
    return environment


def acted(environment, count, seed=0):
    """Takes possible actions after a reset; returns the snapshots, the first included."""
    _, info = environment.reset(seed=seed)
    rng, snapshots = np.random.default_rng(seed), [environment.unwrapped.snapshot]
    for _ in range(count):
        action = int(rng.choice(np.flatnonzero(info["action_mask"])))
        *_, info = environment.step(action)
        snapshots.append(environment.unwrapped.snapshot)
    return snapshots


def changes(pictures):
    """Mean difference of each picture from the one before, shape (k - 1,)."""
    film = np.array(pictures, dtype=float)[:, :90]  # without the words
    return np.abs(np.diff(film, axis=0)).mean(axis=(1, 2, 3))


@pytest.mark.parametrize("settings", [{}, {"robot": "mlivr3"}])
def test_a_film_holds_the_points_that_are_held_and_does_not_jump(settings):
    """MuJoCo says where the grippers are, in all ten configurations of each of four actions.

    Between knots those of followers are within 0.2 mm of their points.
    """
    environment = gymnasium.make("MLIVR-JEM-v0", **settings)
    snapshots, graph = acted(environment, 4), environment.unwrapped.graph
    model = scene_spec(graph.grasp_map, graph.robot).compile()
    data, film = mujoco.MjData(model), snapshot_frames(graph, snapshots)
    assert [len(part) for part in film] == [1, 10, 10, 10, 10]
    before = snapshots[0].state.stance
    for moment, part in zip(snapshots, film, strict=True):
        for k, configuration in enumerate(part):
            set_configuration(model, data, *configuration)
            for limb, point in enumerate(moment.state.stance):
                if point == before[limb] or k == len(part) - 1:
                    found = data.site(f"limb{limb}/grasp").xpos
                    at = graph.grasp_map.positions[point]
                    assert np.linalg.norm(found - at) < (1e-6 if graph.limbs == 2 else 2e-4)
        before = moment.state.stance
    flat = [configuration for part in film for configuration in part]
    bends = [np.abs(b[2] - a[2]).max() for a, b in itertools.pairwise(flat)]
    assert max(bends) < 1.0  # another branch is farther away
    assert min(bends) > 0.0


def test_a_simulated_step_is_shown_as_it_went():
    environment = gymnasium.make("MLIVR-JEM-v0", dynamics="mujoco")
    snapshots = acted(environment, 1)
    film, simulated = (
        snapshot_frames(environment.unwrapped.graph, snapshots),
        snapshots[1].simulated_motion,
    )
    assert [len(part) for part in film] == [1, 10]
    for shot, values in zip(film[1][-1], simulated, strict=True):
        np.testing.assert_array_equal(shot, values[-1])
    # The last sample of a recording is up to a hundredth of a second old.
    here = environment.unwrapped._executor.configuration[2]
    np.testing.assert_allclose(film[1][-1][2], here, atol=1e-3)


@pytest.mark.parametrize("mode", ["rgb_array", "rgb_array_list"])
def test_both_modes_pass_the_checkers(mode):
    """Every warning is an error; Gymnasium's checker would open a window, too."""
    environment = made(mode, collisions=False)
    environment.reset(seed=0)
    env_render_passive_checker(environment.unwrapped)
    environment.close()


@pytest.fixture
def five(monkeypatch):
    """Five pictures of an action, as many as rendering without a graphics card allows."""
    monkeypatch.setattr("mlivr_gym.envs.snapshots.FRAMES_PER_ACTION", 5)


def test_the_list_has_what_moved_since_it_was_read(ladder, five):
    environment = made("rgb_array_list", map=ladder, collisions=False)
    acted(environment, 1)
    film = environment.render()
    assert len(film) == 1 + 5
    assert film[0].shape == (120, 160, 3)
    assert changes(film).min() > 0.0
    assert environment.render() == []
    environment.step(int(environment.unwrapped.action_masks().argmin()))
    assert environment.unwrapped.snapshot.caption.endswith(", an invalid action")
    film = environment.render()
    assert len(film) == 5
    assert not changes(film).any()  # the robot stands
    assert environment.metadata["render_fps"] == 10
    environment.close()


class Clips:
    """Stands for MoviePy: keeps pictures and rate of each film under its file's name."""

    written: ClassVar[dict[str, tuple[list, int]]] = {}

    def __init__(self, pictures, fps):
        self.film = list(pictures), fps

    def write_videofile(self, path, logger):
        self.written[Path(path).name] = self.film


def test_recorded_videos_move_between_stances(ladder, five, tmp_path, monkeypatch):
    """Those of Gymnasium have one picture an action; a film ends with its episode."""
    for name in ("", ".video", ".video.io", ".video.io.ImageSequenceClip"):
        module = ModuleType(f"moviepy{name}")
        module.ImageSequenceClip = Clips
        monkeypatch.setitem(sys.modules, module.__name__, module)
    Clips.written.clear()
    plain = made("rgb_array", map=ladder, collisions=False)
    environment = RecordVideo(plain, str(tmp_path / "films"), episode_trigger=lambda _: True)
    for episode in (0, 1):
        acted(environment, 1, seed=episode)
    environment.close()
    for episode in (0, 1):
        film, rate = Clips.written[f"rl-video-episode-{episode}.mp4"]
        assert len(film) == 1 + 5
        assert changes(film).min() > 0.0
        assert rate == 10
