"""Archives that may be downloaded are data: whatever objects they hold, no code of theirs runs."""

import zipfile
from collections import OrderedDict
from dataclasses import fields
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from small_tables import small_table

from mlivr_gym.errors import MlivrError
from mlivr_gym.extensions.station_load.load import load_recording
from mlivr_gym.simulation.recording import Recording
from mlivr_gym.stances import table_files
from mlivr_gym.stances.graph_table import GraphTable
from mlivr_gym.stances.parts import Parts
from mlivr_gym.stances.table_file import TABLES


class Trap:
    """What makes a file where a careless program unpickles it."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@pytest.fixture
def trapped(tmp_path):
    """A function that reads an archive with a trap in the place of each of its arrays in turn."""
    mark, content = tmp_path / "sprung", BytesIO()
    np.save(content, np.full(3, Trap(mark), dtype=object), allow_pickle=True)

    def read_all(path, read):
        with zipfile.ZipFile(path) as archive:
            whole = {name: archive.read(name) for name in archive.namelist()}
        arrays = [name for name in whole if name.endswith(".npy")]
        assert arrays
        for name in arrays:
            with zipfile.ZipFile(path, "w") as archive:
                for other, old in whole.items():
                    archive.writestr(other, content.getvalue() if other == name else old)
            read(path)
            assert not mark.exists(), name

    yield read_all
    content.seek(0)
    np.load(content, allow_pickle=True)
    assert mark.exists()


def refused(load):
    def read(path):
        with pytest.raises(MlivrError):
            load(path)

    return read


@pytest.mark.parametrize("is_played", [False, True])
def test_a_recording_runs_no_code(tmp_path, walk, trapped, is_played):
    record, load, path = Recording, load_recording, tmp_path / "walk.npz"
    if is_played:
        frames = pytest.importorskip("mlivr_gym.extensions.viewer.frames")
        record, load = frames.Frames, lambda path: frames.load_frames(path, walk)
    np.savez(path, **{field.name: np.zeros(3) for field in fields(record)})
    trapped(path, refused(load))


@pytest.mark.parametrize("mapped", [False, True])
def test_a_table_runs_no_code(tmp_path, monkeypatch, mapped, trapped):
    monkeypatch.setattr(table_files, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(table_files, "_memory", OrderedDict())
    graph, table = small_table(3)
    path, known = tmp_path / "table.npz", GraphTable(table, False)
    if mapped:
        path = TABLES.cache(graph, known)
    else:
        TABLES.write(graph, known, path)
    trapped(path, refused(lambda path: TABLES.read(graph, path)))


def test_a_part_of_a_table_runs_no_code(tmp_path, trapped):
    """It is computed again."""
    parts, array = Parts(tmp_path), np.arange(4)

    def read(_):
        found = parts.get("part", lambda: [array, array])
        np.testing.assert_array_equal(found, [array, array])

    read(None)
    trapped(tmp_path / "part.npz", read)
