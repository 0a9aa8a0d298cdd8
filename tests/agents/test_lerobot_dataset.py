"""Data sets for LeRobot: their frames are the expert's episodes, and its own loader reads them."""

import json

import gymnasium
import numpy as np
import pytest
from gl_there import gl_or_skip

from mlivr_gym.agents import lerobot_dataset
from mlivr_gym.agents.dataset import ExpertPolicy
from mlivr_gym.agents.lerobot_dataset import write_lerobot_dataset
from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.files import FileError
from mlivr_gym.settings import GRAPH_RULES

pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra [data]")
SEED, EPISODES = 3, 4


@pytest.fixture
def arguments(ladder):
    return {"map": ladder, "collisions": False}


@pytest.fixture
def root(tmp_path, arguments):
    folder = tmp_path / "sets" / "jem"
    frames = write_lerobot_dataset(folder, EPISODES, SEED, arguments)
    assert frames == json.loads((folder / "meta/info.json").read_text())["total_frames"]
    return folder


def walked(arguments, actions_of_episodes):
    """Yield the frames of episodes, walked once more by their actions."""
    env = ActionMaskObservation(gymnasium.make("mlivr_gym:MLIVR-JEM-v0", **arguments))
    for k, actions in enumerate(actions_of_episodes):
        observation, _ = env.reset(seed=SEED + k)
        for number, action in enumerate(actions):
            seen = {f"observation.{name}": row for name, row in observation.items()}
            picture = None if env.render_mode is None else env.render()
            observation, reward, done, _, _ = env.step(action)
            yield (
                picture,
                seen
                | {
                    "action": action,
                    "next.reward": reward,
                    "next.done": done,
                    "frame_index": number,
                    "timestamp": number / 10,
                    "episode_index": k,
                    "task_index": 0,
                },
            )
        assert done


def test_frames_are_the_walks_of_the_expert(root, arguments):
    table = pq.read_table(root / "data/chunk-000/file-000.parquet")
    episodes = pq.read_table(root / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    info = json.loads((root / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert info["total_episodes"] == len(episodes) == EPISODES
    assert info["mlivr_gym"]["graph_rules"] == GRAPH_RULES
    assert info["features"].keys() == set(table.column_names)
    ranges = [(one["dataset_from_index"], one["dataset_to_index"]) for one in episodes]
    assert [one["length"] for one in episodes] == [stop - start for start, stop in ranges]
    actions = [table["action"].to_pylist()[start:stop] for start, stop in ranges]
    rows, count = table.to_pylist(), 0
    for k, (_, frame) in enumerate(walked(arguments, actions)):
        assert rows[k].pop("index") == k
        assert rows[k].keys() == frame.keys()
        for name, value in frame.items():
            np.testing.assert_allclose(rows[k][name], value, rtol=1e-6, err_msg=name)
        count += 1
    assert count == len(rows) == info["total_frames"]
    assert count > EPISODES


def test_statistics_are_those_of_the_frames(root):
    table = pq.read_table(root / "data/chunk-000/file-000.parquet")
    statistics = json.loads((root / "meta/stats.json").read_text())
    assert statistics.keys() == set(table.column_names)
    for name, told in statistics.items():
        rows = np.array(table[name].to_pylist(), dtype=np.float64).reshape(len(table), -1)
        assert told["count"] == [len(table)]
        for kind in ("min", "max", "mean", "std"):
            np.testing.assert_allclose(told[kind], getattr(np, kind)(rows, axis=0), atol=1e-9)
        np.testing.assert_allclose(told["q50"], np.median(rows, axis=0), atol=1e-9)


@pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)  # imageio leaves its pipes open
def test_videos_show_what_the_environment_shows(tmp_path, arguments):
    """Their compression changes colours a little; another picture of the walk differs by more."""
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra [film]")
    import imageio.v3 as iio

    root = tmp_path / "set"
    with gl_or_skip():
        write_lerobot_dataset(root, EPISODES, SEED, arguments, video=True)
    info = json.loads((root / "meta/info.json").read_text())
    episodes = pq.read_table(root / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    every = pq.read_table(root / "data/chunk-000/file-000.parquet").to_pylist()
    actions = [[] for _ in episodes]
    for row in every:
        actions[row["episode_index"]].append(row["action"])
    films = []
    for one in episodes:
        place = {
            part: one[f"videos/{lerobot_dataset.CAMERA}/{part}"]
            for part in ("chunk_index", "file_index")
        }
        name = info["video_path"].format(video_key=lerobot_dataset.CAMERA, **place)
        films.append(iio.imread(root / name, plugin="FFMPEG").astype(float))
    assert [len(film) for film in films] == [len(one) for one in actions]
    pictures = arguments | {"render_mode": "rgb_array", "width": 512, "height": 288}
    shown = [np.asarray(picture, float) for picture, _ in walked(pictures, actions)]
    apart = np.abs(np.concatenate(films)[:, None] - np.array(shown)).mean(axis=(2, 3, 4))
    assert (apart.argmin(axis=1) == np.arange(len(shown))).all()
    assert np.diag(apart).max() < 3.0
    told = json.loads((root / "meta/stats.json").read_text())[lerobot_dataset.CAMERA]["mean"]
    np.testing.assert_allclose(np.ravel(told), np.mean(shown, axis=(0, 1, 2)) / 255, atol=0.03)


def test_a_folder_is_written_whole_or_not_at_all(tmp_path, arguments, monkeypatch):
    root, asked = tmp_path / "set", []
    act = ExpertPolicy.act

    def failing(*given):
        asked.append(given)
        if len(asked) == 3:
            raise MlivrError("no more")
        return act(*given)

    monkeypatch.setattr(ExpertPolicy, "act", failing)
    with pytest.raises(MlivrError, match="no more"):
        write_lerobot_dataset(root, EPISODES, SEED, arguments)
    assert not root.exists()
    assert write_lerobot_dataset(root, 1, SEED, arguments)
    with pytest.raises(SettingError, match="exists already"):
        write_lerobot_dataset(root, 1, SEED, arguments)
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="cannot create folder"):
        write_lerobot_dataset(tmp_path / "file" / "set", 1, SEED, arguments)
