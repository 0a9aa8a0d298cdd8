"""Usage, help, examples and exit codes of every command, and what is refused."""

import json
import re
import runpy
import shlex
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from mlivr_gym import __version__
from mlivr_gym.cli.help import GROUPS, CommandParser, output_options
from mlivr_gym.cli.main import _parser, every_command, json_value, main
from mlivr_gym.planners import Planner


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


def test_the_package_is_the_command_and_its_help_tells_the_exit_codes(capsys, monkeypatch):
    printed = []
    for option in ("--version", "--help"):
        monkeypatch.setattr("sys.argv", ["mlivr-gym", option])
        with pytest.raises(SystemExit) as stop:
            runpy.run_module("mlivr_gym", run_name="__main__")
        assert stop.value.code == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == f"mlivr-gym {__version__}\n"
    assert all(f"\n  {code:<3}  " in printed[1] for code in (0, 1, 2, 3, 130))


def test_json_is_all_that_is_printed_also_where_a_command_fails(run, checked_graph):
    walk = Planner(checked_graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), "steps").unwrap()
    code, out, err = run("plan --start D2a:4 D2b:4 --goal 6 0 0.42 --cost steps --json")
    told = json.loads(out)
    assert (code, told["exit_code"]) == (0, 0)
    assert told["base_translation"] == walk.base_translation
    assert [(step["limb"], step["to_point"]) for step in told["steps"]] == [*walk.actions]
    code, out, err = run("plan --goal 60 0 0 --json")
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


SCREEN = 54
"""Lines of a screen."""


def told(capsys, *line):
    """Return what a help prints, and the options that it lists."""
    with pytest.raises(SystemExit):
        main([*line])
    text = capsys.readouterr().out
    return text, re.findall(r"^  (?:-\w(?: \[\w+\])?, )?(--[\w-]+)", text, re.MULTILINE)


@pytest.mark.parametrize("command", every_command())
def test_the_help_of_a_command_fits_a_screen_and_each_option_is_in_one_group(capsys, command):
    text, options = told(capsys, command, "--help")
    assert len(text.splitlines()) <= SCREEN
    groups = re.findall(r"^  --help (\w+)", text, re.MULTILINE)
    options = [name for name in options if name != "--help"]
    for group in groups:
        options += told(capsys, command, "--help", group)[1]
    assert len(options) == len(set(options))
    known = {"--json", "--quiet", *options}
    for group in GROUPS:
        if group not in groups:
            assert main([command, "--help", group]) == 2
            assert f"no group '{group}'" in capsys.readouterr().err
    parser, module = CommandParser(), import_module(every_command()[command][0])
    getattr(module, "add_options", output_options)(parser)
    for name in vars(parser.parse_known_args(["run"])[0]):
        option = f"--{name.replace('_', '-')}"
        assert option in known or (name in ("grace", "file", "folder", "folders", "action"))


def test_the_help_of_plan_has_ten_options(capsys):
    text, options = told(capsys, "plan", "-h")
    count = len([name for name in options if name != "--help"])
    assert count == 10, "put other options into a group of cli/help.py"
    groups = re.findall(r"^  --help (\w+)", text, re.MULTILINE)
    assert set(groups) == {*GROUPS} - {"physics", "film"}


LINES = """
plan --start D1a:4 Q:1                        : 'Q:1'
plan --goal 60 0 0                            : outside the cabin
plan --cost fast                              : --cost is 'fast'; valid choices are 'base', 'steps'
plan --robot robocop                          : 'robocop'
plan --robot mlivr2-iiwa --locked-joint joint2 : --locked-joint has no effect with --robot mlivr2
suggest --robot mlivr3                        : smallest changes need two limbs
plan --failed-joint 0 3 0.5                   : limb 0 has 6 joints: with joint 3 failed it can hold
failures --robot mlivr3                       : failures needs two limbs; 'mlivr3' has 3
load no/folder                                : cannot read simulation
plan --map nowhere.json                       : nowhere.json
plan --map uslab --unit mm                    : --unit mm needs the file of a map, given with --map
plan --map my.csv --unit km                   : --unit is 'km'; valid choices are 'm', 'mm'
plan --out plan.json --picture no/plan.png    : does not exist
plan --no-collisions --clearance 0.1          : --clearance has no effect
render --stance 2                             : --stance needs --plan
render --plan PLAN --stance 5 --out x.png     : --stance is 5; this plan has stances 0 (start) to 4
simulate --plan x.json --case 3               : give only one of
simulate --case 3 --duration 0                : step_duration is 0
simulate --case 3 --pace paper --duration 9   : no effect with --pace paper
simulate --case 3 --film walk.avi             : valid endings
walk --max 3                                  : --max 3; see `mlivr-gym walk --help`
carry --robot mlivr3 --start D3a:8 D3a:1 D3a:4 --pick D2b:3 --stow F2b:4 : --cargo is missing
simulate --plan PLAN --robot mlivr3           : --robot has no effect with --plan
simulate --case 3 --occupied D1a:4            : --occupied has no effect with --case
evaluate --split same --episodes 3            : --episodes has no effect
train --method bc --shaping                   : --shaping has no effect
dataset --lerobot x --id a-v0                 : --id has no effect with --lerobot
view --plan a --execution b                   : --plan has no effect with --execution
"""
"""Command lines, and words of what is told."""

NEEDED = {"view": "viser", "train": "sb3_contrib", "dataset": "minari"}
"""Packages of the extras that commands need before they look at anything else."""


@pytest.mark.parametrize("line", LINES.strip().splitlines())
def test_what_cannot_be_used_is_one_sentence_and_code_2(
    run, tmp_path, monkeypatch, plan_file, line
):
    command, words = (part.strip() for part in line.split(" : "))
    pytest.importorskip(NEEDED.get(command.split()[0], "numpy"))
    monkeypatch.chdir(tmp_path)
    code, _, err = run(command.replace("PLAN", str(plan_file)))
    assert code == 2
    assert words in err
    assert err.startswith("mlivr-gym: ")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())
