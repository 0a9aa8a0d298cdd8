"""Usage, exit codes and interruptions of every command."""

import json
import runpy
import shlex
from pathlib import Path

import numpy as np
import pytest

from mlivr_gym import __version__
from mlivr_gym.cli.main import _parser, every_command, json_value, main
from mlivr_gym.planners import Planner


def test_the_help_tells_the_exit_codes(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    out = capsys.readouterr().out
    assert all(f"\n  {code:<3}  " in out for code in (0, 1, 2, 3, 130))
    assert "no plan" in out


@pytest.mark.parametrize(
    "arguments", [[], ["fly"], ["plan", "--goal", "a", "b", "c"], ["plan", "--wings"]]
)
def test_bad_usage_gives_one_sentence_and_code_2(capsys, arguments):
    assert main(arguments) == 2
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert main([*arguments, "--json"]) == 2
    told = capsys.readouterr()
    error = json.loads(told.out)
    assert error == {"exit_code": 2, "error": told.err.removeprefix("mlivr-gym: ").rstrip("\n")}


def test_every_command_has_examples_of_its_own_which_its_parser_takes(capsys):
    """As they stand in its help, and in the help of no other command."""
    for command, (_, (_, *lines)) in every_command().items():
        with pytest.raises(SystemExit) as stop:
            main([command, "--help"])
        assert stop.value.code == 0
        shown = capsys.readouterr().out.split("examples:\n")[1]
        assert shown == "".join(f"  {line}\n" for line in lines)
        for line in lines:
            bare = line.split("|")[0].split("#")[0].strip()
            words = shlex.split(bare.removeprefix('eval "$(').removesuffix(')"'))
            assert words[:2] == ["mlivr-gym", command]
            _parser(words).parse_args(words[1:])


def test_the_package_is_the_command(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["mlivr-gym", "--version"])
    with pytest.raises(SystemExit) as stop:
        runpy.run_module("mlivr_gym", run_name="__main__")
    assert stop.value.code == 0
    assert capsys.readouterr().out == f"mlivr-gym {__version__}\n"


def test_json_is_all_that_is_printed_also_where_a_command_fails(run, checked_graph):
    start, goal = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)
    walk = Planner(checked_graph).plan(start, goal, "steps").unwrap()
    arguments = ("--start", "D2a:4", "D2b:4", "--goal", "6", "0", "0.42", "--cost", "steps")
    code, out, err = run("plan", *arguments, "--json")
    told = json.loads(out)
    assert (code, told["exit_code"]) == (0, 0)
    assert told["base_translation"] == walk.base_translation
    assert [(step["limb"], step["to_point"]) for step in told["steps"]] == [*walk.actions]
    code, out, err = run("plan", "--goal", "60", "0", "0", "--json")
    told = json.loads(out)
    assert (code, told["exit_code"]) == (2, 2)
    assert "outside the cabin" in told["error"]
    assert err.endswith(f"mlivr-gym: {told['error']}\n")


def test_a_result_becomes_what_json_knows():
    given = {"a": np.array([1.0, np.nan]), "b": (Path("x"), np.int64(3), True, None), 4: np.inf}
    told = json.loads(json.dumps(json_value(given), allow_nan=False))
    assert told == {"a": [1.0, None], "b": ["x", 3, True, None], "4": None}


def test_quiet_prints_errors_alone(run):
    assert run("info", "--quiet") == (0, "", "")
    code, out, err = run("plan", "-q", "--cost", "fast")
    assert (code, out, err.count("\n")) == (2, "", 1)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), KeyboardInterrupt("two of three done")])
def test_an_interruption_is_told_in_one_line(run, monkeypatch, error):
    def stop(_):
        raise error

    stop.__module__ = "mlivr_gym.cli.info"
    monkeypatch.setattr("mlivr_gym.cli.info.run", stop)
    code, out, err = run("info")
    assert code == 130
    assert out == ""
    assert err == f"mlivr-gym: {str(error) or 'interrupted'}\n"
