"""A command that is refused or fails leaves nothing behind, and replaces nothing in silence."""

import argparse
import errno
import json
import os

import pytest

from mlivr_gym.cli.outputs import all_or_none, check_outputs
from mlivr_gym.files import FileError, make_folder, write_whole
from mlivr_gym.planners import Planner


def files(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def test_what_will_be_replaced_is_told(tmp_path, capsys):
    old, new = tmp_path / "old.json", tmp_path / "new.json"
    old.touch()
    check_outputs(old, None, new)
    assert capsys.readouterr() == ("", f"mlivr-gym: existing files to be replaced: {old}\n")
    many = [tmp_path / f"{k}.png" for k in range(6)]
    for file in many:
        file.touch()
    check_outputs(new, *many)
    names = ", ".join(map(str, many[:3]))
    line = f"mlivr-gym: existing files to be replaced: {names} and 3 more\n"
    assert capsys.readouterr() == ("", line)
    with pytest.raises(FileError, match="two outputs have this name"):
        check_outputs(new, tmp_path / "x" / ".." / "new.json", folder=tmp_path / "x" / "..")


def test_a_folder_that_will_be_made_may_be_missing(tmp_path):
    folder = tmp_path / "a" / "b"
    check_outputs(folder / "plan.json", folder=folder)
    with pytest.raises(FileError, match=r"folder .* does not exist"):
        check_outputs(folder / "c" / "walk.gif", folder=folder)
    (tmp_path / "f").touch()
    with pytest.raises(FileError, match="is not a folder"):
        check_outputs(tmp_path / "f" / "x" / "plan.json", folder=tmp_path / "f" / "x")
    with pytest.raises(FileError, match="cannot create folder"):
        make_folder(tmp_path / "f" / "x")
    assert files(tmp_path) == {"f"}


def test_both_files_of_a_picture_are_claimed(run, tmp_path):
    """The SVG beside the PNG is told before it is replaced, and may not be the plan's file."""
    old, picture = tmp_path / "plan.svg", tmp_path / "plan.png"
    old.touch()
    code, _, err = run("plan", "--picture", str(picture), "--limit", "1", "--quiet")
    assert code == 3
    assert err.startswith(f"mlivr-gym: existing files to be replaced: {old}\n")
    assert files(tmp_path) == {"plan.svg"}
    code, _, err = run("plan", "--out", str(old), "--picture", str(picture))
    assert code == 2
    assert "two outputs have this name" in err


@pytest.mark.parametrize("command", ["render", "build"])
def test_a_command_does_not_replace_its_own_map(run, tmp_path, monkeypatch, command):
    """The map is named in another way than the output, and stays as it is."""
    (tmp_path / "my.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    code, _, err = run(command, "--map", str(tmp_path / "my.json"), "--out", "my.json", "--quiet")
    assert code == 2
    assert "cannot write 'my.json': it is the file of --map" in err
    assert (tmp_path / "my.json").read_text() == "{}"


@pytest.mark.parametrize("made", [True, False])
def test_the_files_of_a_command_are_there_when_it_says_so(tmp_path, capsys, made):
    folder, args = tmp_path / "a" / "b", argparse.Namespace(result={})
    if made:
        folder.mkdir(parents=True)
    with pytest.raises(FileError), all_or_none(args, folder):
        write_and_say(args, folder, "one", "no/two")
    assert files(tmp_path) == ({"a", "a/b"} if made else set())
    assert (capsys.readouterr().out, args.result) == ("", {})
    with all_or_none(args, folder):
        write_and_say(args, folder, "one", "two")
        assert capsys.readouterr().out == ""
    assert files(folder) == {"one", "two"}
    assert capsys.readouterr().out == "one\ntwo\n"
    assert args.result == {"files": ["one", "two"], "folder": folder}


def write_and_say(args, folder, *names):
    args.result |= {"files": list(names), "folder": folder}
    for name in names:
        write_whole(folder / name, name)
        print(name)


@pytest.mark.parametrize(
    ("last", "line"),
    [
        ("plan.svg", "plan --start D2a:4 D2b:4 --goal 2.8 0 0 --out plan.json --picture plan.png"),
        ("walk.gif", "simulate --plan PLAN --size 64 32 --speed 100 --out ."),
    ],
)
def test_a_command_leaves_all_of_its_files_or_none(
    run, tmp_path, walk, checked_graph, monkeypatch, last, line
):
    """The last one cannot get its name; those that were there before are there again."""
    out, plan = tmp_path / "out", tmp_path / "plan.json"
    out.mkdir()
    one_step = walk.stances[0], walk.motion.base_positions[1], "steps"
    Planner(checked_graph).plan(*one_step).unwrap().save(plan)
    monkeypatch.chdir(out)
    words = line.replace("PLAN", str(plan)).split()
    code, _, err = run(*words)
    assert (code, err) == (0, "")
    names, replace, told = files(out), os.replace, "that file is in use"
    assert last in names
    assert len(names) > 1

    def refuse(source, target):
        if os.path.basename(target) == last:
            raise OSError(errno.EBUSY, told)
        replace(source, target)

    monkeypatch.setattr("mlivr_gym.files.os.replace", refuse)
    for old in ({name: f"old {name}" for name in names}, {}):
        for path in out.iterdir():
            path.unlink()
        for name, text in old.items():
            (out / name).write_text(text)
        code, printed, err = run(*words, "--json")
        assert code == 2
        assert err.splitlines()[-1].endswith(f"{last}': {told}")
        assert "files" not in json.loads(printed)
        assert {path.name: path.read_text() for path in out.iterdir()} == old
