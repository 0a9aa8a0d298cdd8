import ast
import errno
import json
import os
import re
import stat
import threading
from pathlib import Path

import pytest

import mlivr_gym
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MapError
from mlivr_gym.files import FileError, read_json, write_whole, written_together

FAULTS = {
    "deep": (b'{"a": ' + b"[" * 3000 + b"]" * 3000 + b"}", "nested too deeply"),
    "digits": (b'{"a": ' + b"7" * 5000 + b"}", "number 7777.* has 5000 digits"),
    "overflow": (b'{"a": -1' + b"0" * 400 + b"}", "number -1000.* has 402 digits"),
    "float": (b'{"a": 1e400}', "number 1e400 is not finite"),
    "nan": (b'{"a": NaN}', "number NaN is not finite"),
    "infinity": (b'{"a": -Infinity}', "number -Infinity is not finite"),
    "list": (b"[1, 2]", "JSON object, not a list"),
    "deeper": (b'{"a": ' + b"[" * 500 + b"]" * 500 + b"}", "nested too deeply"),
    "syntax": (b'{"a" 1}', "not JSON: .*line 1 column 6"),
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
    with pytest.raises(FileError, match=r"cannot read thing|must be the path of a file"):
        read_json(path, "thing")


def test_valid_json_is_read_as_it_is(tmp_path):
    data = {"a": [1, -2.5, 1e300, 10**300, True, None, "é"], "b": {"c": []}}
    data["deep"] = json.loads("[" * 499 + "]" * 499)
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
    with pytest.raises(FileError, match=r"cannot write|must be the path of a file"):
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


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444, 0o755])
def test_a_file_that_is_replaced_keeps_its_permissions(tmp_path, mode):
    path = tmp_path / "file"
    path.write_text("old")
    path.chmod(mode)
    write_whole(path, "new")
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == mode


def test_a_private_file_is_private_at_every_moment(tmp_path, monkeypatch):
    path, seen = tmp_path / "file", []
    path.write_text("old")
    path.chmod(0o600)

    def look(*_):
        if len(present := list(tmp_path.iterdir())) > 1:  # not where the folder is synced at last
            seen.extend(stat.S_IMODE(one.stat().st_mode) for one in present)

    monkeypatch.setattr("mlivr_gym.files.os.fsync", look)
    write_whole(path, "new")
    assert seen == [0o600, 0o600]


def test_a_file_and_its_new_name_are_on_the_disk_when_it_is_written(tmp_path, monkeypatch):
    """After a power cut, too: all the content before it gets its name, then the folder."""
    synced, real = [], os.fsync

    def noted(handle):
        state = os.fstat(handle)
        size = state.st_size if stat.S_ISREG(state.st_mode) else None
        synced.append((state.st_ino, size, (tmp_path / "file").exists()))
        real(handle)

    monkeypatch.setattr("mlivr_gym.files.os.fsync", noted)
    write_whole(tmp_path / "file", "new")
    file, folder = (path.stat().st_ino for path in (tmp_path / "file", tmp_path))
    assert synced == [(file, 3, False), (folder, None, True)]


def test_links_stay_and_the_file_at_their_end_is_replaced(tmp_path):
    away = tmp_path / "away"
    away.mkdir()
    target, link, chain = away / "file", tmp_path / "link", tmp_path / "chain"
    link.symlink_to(Path("away") / "file")
    chain.symlink_to(link)
    for content in ("made at the end of links", "replaced"):
        write_whole(chain, content)
        assert target.read_text() == content
        target.chmod(0o600)
    assert link.is_symlink()
    assert chain.is_symlink()
    assert stat.S_IMODE(target.stat().st_mode) == 0o600
    assert list(away.iterdir()) == [target]
    assert sorted(tmp_path.iterdir()) == [away, chain, link]
    (tmp_path / "round").symlink_to("round")
    (tmp_path / "nowhere").symlink_to("no/file")
    for name in ("round", "nowhere"):
        with pytest.raises(FileError, match="cannot write"):
            write_whole(tmp_path / name, "new")
        assert (tmp_path / name).is_symlink()


@pytest.mark.parametrize("name", ["folder", "link", "folder/", "new/", ""])
def test_a_folder_is_refused_in_words(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    Path("folder").mkdir()
    Path("link").symlink_to("folder")
    with pytest.raises(FileError, match="it is a folder; give the name of a file"):
        write_whole(name, "new")
    assert sorted(map(str, Path().rglob("*"))) == ["folder", "link"]


@pytest.mark.parametrize("call", ["open", "fsync", "chmod", "replace"])
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


def test_a_pipe_is_written_into(tmp_path):
    pipe, got = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()), daemon=True)
    reader.start()
    write_whole(pipe, "new")
    reader.join(60)
    assert got == [b"new"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.fixture
def old_files(tmp_path):
    """A folder with two files; the third of `write_three` is new."""
    for name in ("a", "b"):
        (tmp_path / name).write_text(f"old {name}")
    (tmp_path / "a").chmod(0o600)
    return tmp_path


def write_three(folder):
    with written_together():
        for name in ("a", "new", "b"):
            write_whole(folder / name, f"new {name}")
            assert contents(folder).get(name) != f"new {name}"


@pytest.mark.parametrize("error", [OSError(errno.EPERM, "not permitted"), KeyboardInterrupt()])
@pytest.mark.parametrize("call", ["fsync", "replace"])
@pytest.mark.parametrize("after", range(3))
@pytest.mark.parametrize("links", [True, False])
def test_all_files_are_written_or_none(old_files, monkeypatch, call, after, error, links):
    """Also if what fails is the last of all renamings, on a file system with or without links."""
    real, calls = getattr(os, call), []

    def fails(*arguments):
        calls.append(arguments)
        if len(calls) == after + 1:
            raise error
        return real(*arguments)

    def no_links(*_):
        raise OSError(errno.ENOTSUP, "no hard links here")

    def told():
        states = {path.name: path.stat() for path in old_files.iterdir()}
        return {name: (one.st_mode, one.st_mtime_ns) for name, one in states.items()}

    before = told()
    monkeypatch.setattr(f"mlivr_gym.files.os.{call}", fails)
    if not links:
        monkeypatch.setattr("mlivr_gym.files.os.link", no_links)
    with pytest.raises((FileError, KeyboardInterrupt)):
        write_three(old_files)
    assert len(calls) > after
    assert contents(old_files) == {"a": "old a", "b": "old b"}
    assert told() == before  # a private file is private still
    monkeypatch.undo()
    write_three(old_files)
    assert contents(old_files) == {name: f"new {name}" for name in ("a", "b", "new")}


def test_other_threads_do_not_wait_for_a_block(old_files):
    with written_together():
        thread = threading.Thread(target=write_whole, args=(old_files / "a", "new a"))
        thread.start()
        thread.join()
        assert contents(old_files) == {"a": "new a", "b": "old b"}


LIBRARIES = ("np", "torch", "plt", "figure", "pq", "shutil", "tempfile")
IN_MEMORY = ("buffer", "stream", "member")


def writes(call):
    """Whether a call writes a file by itself, as far as its words tell."""
    words = ast.unparse(call.func)
    base, _, name = words.rpartition(".")
    modes = [one.value for one in [*call.args, *(k.value for k in call.keywords)]
             if isinstance(one, ast.Constant) and isinstance(one.value, str)]  # fmt: skip
    if name == "open":
        return any(re.fullmatch(r"r?[wax+]+[bt+]?", mode) for mode in modes)
    if name.startswith(("save", "write_table")):
        is_library = base in LIBRARIES or not base.replace(".", "_").isidentifier()
        given = {ast.unparse(one) for one in call.args}
        return bool(base) and is_library and not given.intersection(IN_MEMORY)
    alone = "write_text write_bytes tofile touch umask rename symlink_to mkstemp TemporaryFile"
    return name in alone.split() or words in ("os.replace", "shutil.move", "shutil.copy")


def test_one_function_writes_all_files():
    """What opens, replaces or saves a file by itself would not do what this file tests."""
    allowed = {
        ("files.py", "open"),
        ("files.py", "os.replace"),
        ("compiled/machine_code.py", "path.write_text"),  # one number; none if it is damaged
        ("stances/table_files.py", "archive.open"),  # in memory
        ("extensions/reaction/rank.py", "candidates[0].plan.save"),  # of a plan
    }
    root, found = Path(mlivr_gym.__file__).parent, set()
    for folder in (root, *(root / name for name in ("planners", "agents", "envs_assets"))):
        for path in folder.rglob("*.py"):
            for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(call, ast.Call) and writes(call):
                    found.add((path.relative_to(root).as_posix(), ast.unparse(call.func)))
    assert found == allowed
