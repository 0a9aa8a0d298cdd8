"""Data sets of expert episodes in the format LeRobot v3: Parquet tables, JSON, and videos.

A frame is what was seen before a step, with action and reward; each episode has a video of its own.
"""

from __future__ import annotations

import io
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym import __version__
from mlivr_gym.agents.dataset import ExpertEpisode, expert_env, expert_episodes
from mlivr_gym.arguments import SEED, FileName, checked
from mlivr_gym.errors import SettingError, path_shown
from mlivr_gym.extras import require
from mlivr_gym.files import make_folder, write_whole, written_together
from mlivr_gym.pictures.films import DEFAULT_SIZE, RATE, check_film_format, mp4
from mlivr_gym.schema import Flag, Integer
from mlivr_gym.settings import GRAPH_RULES

TASK = "Climb hand over hand until the base is at the goal."
"""What the robot is told to do in all episodes."""

CAMERA = "observation.images.scene"
"""Name of the pictures."""

FILES_PER_CHUNK = 1000
"""Number of videos in a folder."""


@checked({"folder": FileName(), "episodes": Integer(1, 10**9), "seed": SEED, "video": Flag()})
def write_lerobot_dataset(
    folder: str | Path,
    episodes: int,
    seed: int = 0,
    env_arguments: dict[str, Any] | None = None,
    video: bool = False,
    progress: Callable[[int], None] | None = None,
) -> int:
    """Write the episodes of `write_dataset` in the format LeRobot v3, and return the frames.

    The folder is the `root` that `LeRobotDataset` takes. `video` adds pictures of the scene, which
    take most of the time. Further arguments are those of `write_dataset`.

    Raises a `SettingError` if the folder exists or the extra [data] is not installed, a
    `RenderError` if there can be no videos, and a `FileError` if the folder cannot be written.
    """
    require("pyarrow", extra="data")
    root = Path(folder)
    if os.path.lexists(root):
        raise SettingError(f"folder {path_shown(folder)} exists already; give a new one")
    given = dict(env_arguments or {})
    if video:
        check_film_format("scene.mp4")
        given |= {"render_mode": "rgb_array", "width": DEFAULT_SIZE[0], "height": DEFAULT_SIZE[1]}
    env = expert_env(given)
    make_folder(root)
    try:
        with written_together():
            made = []
            for k, episode in enumerate(expert_episodes(env, episodes, seed, progress)):
                if video:
                    _write(root, f"videos/{CAMERA}/{{}}.mp4", mp4(episode.pictures), k)
                    # Of the pictures only what statistics are made of is kept.
                    episode.pictures[:] = [one[::32, ::32].copy() for one in episode.pictures]
                made.append(episode)
            robot = env.get_wrapper_attr("graph").robot.name
            return _write_tables(root, made, robot, video)
    except BaseException:
        shutil.rmtree(root, ignore_errors=True)
        raise
    finally:
        env.close()


def _write_tables(root: Path, made: list[ExpertEpisode], robot: str, video: bool) -> int:
    """Write all but the videos, and return the number of frames."""
    columns = _columns(made)
    lengths = np.array([len(episode.actions) for episode in made])
    features: dict[str, Any] = {
        name: {"dtype": values.dtype.name, "shape": list(values.shape[1:]) or [1], "names": None}
        for name, values in columns.items()
    }
    statistics = {name: _statistics(values) for name, values in columns.items()}
    if video:
        features[CAMERA] = {
            "dtype": "video",
            "shape": [*DEFAULT_SIZE[::-1], 3],
            "names": ["height", "width", "channels"],
            "info": {"video.fps": RATE, "video.codec": "h264", "video.pix_fmt": "yuv420p"},
        }
        pictures = [picture for episode in made for picture in episode.pictures]
        pixels = np.stack(pictures).reshape(-1, 3)
        colours = _statistics(pixels / 255.0).items()
        statistics[CAMERA] = {name: np.reshape(row, (-1, 1, 1)).tolist() for name, row in colours}
    name = "chunk-{chunk_index:03d}/file-{file_index:03d}"
    info: dict[str, Any] = {
        "codebase_version": "v3.0",
        "robot_type": robot,
        "total_episodes": len(made),
        "total_frames": int(lengths.sum()),
        "total_tasks": 1,
        "chunks_size": FILES_PER_CHUNK,
        "fps": RATE,
        "splits": {"train": f"0:{len(made)}"},
        "data_path": f"data/{name}.parquet",
        "video_path": f"videos/{{video_key}}/{name}.mp4" if video else None,
        "features": features,
        "mlivr_gym": {"version": __version__, "graph_rules": GRAPH_RULES},
    }
    _write(root, "meta/info.json", json.dumps(info, indent=1))
    _write(root, "meta/stats.json", json.dumps(statistics))
    _write(root, "data/{}.parquet", _parquet(columns))
    _write(root, "meta/episodes/{}.parquet", _parquet(_of_episodes(lengths, video)))
    # Tasks are the index of a data frame, as pandas stores it.
    index = {"name": None, "field_name": "task", "pandas_type": "unicode", "numpy_type": "object"}
    pandas = {"index_columns": ["task"], "column_indexes": [], "columns": [index]}
    tasks = _parquet({"task_index": [0], "task": [TASK]}, {"pandas": json.dumps(pandas)})
    _write(root, "meta/tasks.parquet", tasks)
    return int(lengths.sum())


def _columns(made: list[ExpertEpisode]) -> dict[str, NDArray[Any]]:
    """Return what is known of each frame, shape (k,) or (k, width)."""
    lengths = [len(episode.actions) for episode in made]
    seen = [observation for episode in made for observation in episode.observations[:-1]]
    number = np.concatenate([np.arange(length) for length in lengths])
    columns: dict[str, NDArray[Any]] = {
        f"observation.{name}": np.stack([np.asarray(one[name]).ravel() for one in seen])
        for name in seen[0]
    }
    return columns | {
        "action": np.concatenate([episode.actions for episode in made]).astype(np.int64),
        "next.reward": np.concatenate([episode.rewards for episode in made]).astype(np.float32),
        "next.done": number == np.repeat(lengths, lengths) - 1,
        "timestamp": (number / RATE).astype(np.float32),
        "frame_index": number,
        "episode_index": np.repeat(np.arange(len(made)), lengths),
        "index": np.arange(len(number)),
        "task_index": np.zeros(len(number), dtype=np.int64),
    }


def _of_episodes(lengths: NDArray[Any], video: bool) -> dict[str, Any]:
    """Return what is known of each episode, from their numbers of frames, shape (e,)."""
    numbers, zeros, ends = np.arange(len(lengths)), np.zeros_like(lengths), np.cumsum(lengths)
    columns: dict[str, Any] = {
        "episode_index": numbers,
        "tasks": [[TASK]] * len(lengths),
        "length": lengths,
        "dataset_from_index": ends - lengths,
        "dataset_to_index": ends,
    }
    for part in ("data", "meta/episodes"):
        columns |= {f"{part}/chunk_index": zeros, f"{part}/file_index": zeros}
    if video:
        columns |= {
            f"videos/{CAMERA}/chunk_index": numbers // FILES_PER_CHUNK,
            f"videos/{CAMERA}/file_index": numbers % FILES_PER_CHUNK,
            f"videos/{CAMERA}/from_timestamp": zeros.astype(np.float64),
            f"videos/{CAMERA}/to_timestamp": lengths / RATE,
        }
    return columns


def _statistics(values: NDArray[Any]) -> dict[str, Any]:
    """Return the statistics of a column, lists of its width."""
    rows = values.reshape(len(values), -1).astype(np.float64)
    found = {name: getattr(rows, name)(axis=0) for name in ("min", "max", "mean", "std")}
    found |= {f"q{q:02d}": np.percentile(rows, q, axis=0) for q in (1, 10, 50, 90, 99)}
    return {name: row.tolist() for name, row in found.items()} | {"count": [len(rows)]}


def _parquet(columns: dict[str, Any], metadata: dict[str, str] | None = None) -> bytes:
    """Return a Parquet file of columns; those of shape (k, width) are lists of fixed length."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays, stream = {}, io.BytesIO()
    for name, values in columns.items():
        if isinstance(values, np.ndarray) and values.ndim == 2:
            arrays[name] = pa.FixedSizeListArray.from_arrays(values.ravel(), values.shape[1])
        else:
            arrays[name] = pa.array(values)
    pq.write_table(pa.table(arrays).replace_schema_metadata(metadata), stream)
    return stream.getvalue()


def _write(root: Path, name: str, content: str | bytes, k: int = 0) -> None:
    """Write a file, of whose name {} stands for number k, into a folder that is made."""
    path = root / name.format("chunk-{:03d}/file-{:03d}".format(*divmod(k, FILES_PER_CHUNK)))
    make_folder(path.parent)
    write_whole(path, content)
