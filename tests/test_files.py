import errno
import json
import os
import stat

import pytest

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MapError
from mlivr_gym.files import FileError, read_json, write_whole

FAULTS = {
    "deep": (b'{"a": ' + b"[" * 3000 + b"]" * 3000 + b"}", "nested too deeply"),
    "digits": (b'{"a": ' + b"7" * 5000 + b"}", "number 7777.* has 5000 digits"),
    "overflow": (b'{"a": -1' + b"0" * 400 + b"}", "number -1000.* has 402 digits"),
    "float": (b'{"a": 1e400}', "number 1e400 is not finite"),
    "nan": (b'{"a": NaN}', "number NaN is not finite"),
    "infinity": (b'{"a": -Infinity}', "number -Infinity is not finite"),
    "list": (b"[1, 2]", "JSON object, not a list"),
    "syntax": (b'{"a": 1,}', "not JSON: .*line 1 column 9"),
    "twice": (b'{"b": {"a": 1, "a": 2}}', "an object has the field 'a' twice"),
    "empty": (b"", "not JSON"),
    "latin": ('{"a": "é"}'.encode("latin-1"), "not UTF-8"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_of_a_json_file_is_one_error_that_names_it(tmp_path, fault):
    content, words = FAULTS[fault]
    path = tmp_path / "walk.json"
    path.write_bytes(content)
    with pytest.raises(MapError, match=rf"^cannot read map '.*walk\.json': .*{words}") as told:
        read_json(path, "map", MapError)
    assert len(str(told.value)) < 400


@pytest.mark.parametrize("path", ["nowhere.json", ".", "a\0b", "n" * 5000, "/dev/zero"])
def test_what_is_no_file_is_one_error(path):
    with pytest.raises(FileError, match="cannot read thing"):
        read_json(path, "thing")


def test_valid_json_is_read_as_it_is(tmp_path):
    data = {"a": [1, -2.5, 1e300, 10**300, True, None, "é"], "b": {"c": []}}
    path = tmp_path / "ok.json"
    path.write_text(json.dumps(data), encoding="utf-8")
    assert read_json(path, "thing") == data
    path.write_text("\ufeff" + json.dumps(data), encoding="utf-8")  # as Windows' editors write it
    assert read_json(path, "thing") == data
    with open(asset_path("jem.json"), encoding="utf-8") as stream:
        assert read_json(asset_path("jem.json"), "map") == json.load(stream)


@pytest.mark.parametrize("name", ["a\0b", "\ud800", "no/x.json", "n" * 300, "."])
def test_what_cannot_be_written_is_one_error(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError, match="cannot write"):
        write_whole(name, "{}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", ["text é", b"bytes"])
def test_a_file_is_replaced_and_never_written_into(tmp_path, content):
    """Another name of the old file keeps the old content: what reads it never sees a half."""
    path, other = tmp_path / "file", tmp_path / "other"
    write_whole(path, "old")
    os.link(path, other)
    write_whole(path, content)
    assert path.read_bytes() == (content if isinstance(content, bytes) else content.encode())
    assert other.read_text() == "old"
    assert sorted(tmp_path.iterdir()) == [path, other]
    before = os.umask(0o027)
    try:
        write_whole(path, content)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


@pytest.mark.parametrize("call", ["fdopen", "chmod", "replace"])
def test_a_file_that_cannot_be_written_stays_as_it_was(tmp_path, monkeypatch, call):
    """Wherever writing fails, in one error, and nothing is left behind."""
    path = tmp_path / "file"
    path.write_text("old")

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(f"mlivr_gym.files.os.{call}", full)
    with pytest.raises(FileError, match=r"cannot write .*file': No space left on device"):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
