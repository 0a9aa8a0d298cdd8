"""Data sets are the episodes of the expert, for Minari and LeRobot; faults are told first."""

import importlib.util
import json
import sys

import gymnasium
import numpy as np
import pytest
from gl_there import gl_or_skip

from mlivr_gym.agents import dataset, lerobot_dataset
from mlivr_gym.agents.dataset import ExpertPolicy, load_dataset, write_dataset
from mlivr_gym.agents.lerobot_dataset import write_lerobot_dataset
from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.files import FileError
from mlivr_gym.planners import Planner
from mlivr_gym.settings import GRAPH_RULES

minari = pytest.importorskip("minari", reason="needs the extra [data]")
pytest.importorskip("jax", reason="needs the extra [data]")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "sets"))
    return tmp_path / "sets"


@pytest.fixture
def arguments(ladder):
    return {"map": ladder, "collisions": False}


@pytest.fixture
def nothing_collected(monkeypatch):
    made = "an environment was made"
    monkeypatch.setattr(dataset.gymnasium, "make", lambda *_, **__: pytest.fail(made))


@pytest.mark.parametrize(
    "name", ["foo", "foo-v1.2", "mlivr jem-v0", "../foo-v0", "foo-v0\n", None, "n" * 300 + "-v0"]
)
def test_ids_that_minari_would_refuse_in_the_end_are_refused_first(folder, nothing_collected, name):
    with pytest.raises(SettingError, match="data set") as caught:
        write_dataset(name, 2)
    assert "'mlivr/jem/expert-v0'" in str(caught.value) or "too long" in str(caught.value)
    assert not folder.exists() or not any(folder.iterdir())


def test_an_id_that_is_taken_is_refused_first(folder, arguments, monkeypatch):
    write_dataset("foo-v0", 1, env_arguments=arguments)
    (folder / "half" / "bar-v0").mkdir(parents=True)  # no data set, but in its place
    (folder / "file").write_text("")
    monkeypatch.setattr(
        dataset.ExpertPolicy, "act", lambda *_: pytest.fail("an episode was collected")
    )
    taken = {"foo-v0": "already", "half/bar-v0": "already", "file/foo-v0": "cannot be written"}
    for name, words in taken.items():
        with pytest.raises(SettingError, match=words):
            write_dataset(name, 1, env_arguments=arguments)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder / "file"))
    with pytest.raises(SettingError, match="cannot be written"):
        write_dataset("foo-v1", 1, env_arguments=arguments)


@pytest.mark.parametrize("package", ["minari", "h5py", "jax"])
def test_a_missing_extra_is_one_clear_error_before_collecting(
    folder, nothing_collected, monkeypatch, package
):
    find, told = importlib.util.find_spec, rf"the package '{package}': pip install '.*\[data\]'"

    def lacking(name, *rest):
        return None if name == package else find(name, *rest)

    monkeypatch.setattr(importlib.util, "find_spec", lacking)
    monkeypatch.setitem(sys.modules, package, None)
    for call in (lambda: write_dataset("foo-v0", 1), lambda: load_dataset("foo-v0")):
        with pytest.raises(SettingError, match=told):
            call()


def test_a_data_set_of_other_rules_is_refused(folder, arguments):
    write_dataset("foo-v0", 1, env_arguments=arguments)
    file = folder / "foo-v0" / "data" / "metadata.json"
    data = json.loads(file.read_text())
    assert data.pop("graph_rules") == GRAPH_RULES
    for number, said in ((None, "1"), (GRAPH_RULES + 1, str(GRAPH_RULES + 1))):
        file.write_text(json.dumps(data | ({} if number is None else {"graph_rules": number})))
        with pytest.raises(SettingError) as caught:
            load_dataset("foo-v0")
        assert str(caught.value) == (
            f"data set 'foo-v0' was made by rules {said} of the stance graph, and this version has "
            f"rules {GRAPH_RULES}: write it again with write_dataset"
        )
    with pytest.raises(SettingError, match="cannot load data set 'bar-v0'"):
        load_dataset("bar-v0")


def test_data_set_holds_optimal_masked_walks_and_rebuilds_its_environment(folder, arguments):
    """With a map object, which goes into the data set as plain data."""
    name = "a-b/c_d/test-v12"
    assert write_dataset(name, 2, seed=3, env_arguments=arguments).id == name
    dataset = minari.load_dataset(name)
    assert dataset.total_episodes == 2
    rebuilt = dataset.recover_environment()
    assert rebuilt.unwrapped.graph.grasp_map.fingerprint == arguments["map"].fingerprint
    planner = Planner(rebuilt.unwrapped.graph)
    for episode in dataset.iterate_episodes():
        observation, info = rebuilt.reset(seed=3 + int(episode.id))
        plan = planner.plan(info["stance"], rebuilt.unwrapped.goal, "steps").unwrap()
        assert len(episode.actions) == len(plan.steps) == -episode.rewards.sum()
        assert episode.terminations[-1]
        for k, action in enumerate(episode.actions):
            for name, rows in episode.observations.items():
                np.testing.assert_array_equal(rows[k], observation[name])
            assert episode.observations["action_mask"][k][action]
            observation, *_ = rebuilt.step(action)


pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra [data]")
SEED, EPISODES = 3, 4


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
            frame = {f"observation.{name}": row for name, row in observation.items()}
            frame |= {"episode_index": k, "frame_index": number, "timestamp": number / 10}
            picture = None if env.render_mode is None else env.render()
            observation, reward, done, _, _ = env.step(action)
            frame |= {"action": action, "next.reward": reward, "next.done": done, "task_index": 0}
            yield picture, frame
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
        parts = ("chunk_index", "file_index")
        place = {part: one[f"videos/{lerobot_dataset.CAMERA}/{part}"] for part in parts}
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
