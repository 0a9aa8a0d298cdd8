"""Help of commands: one screen each, and every option in one of its groups."""

import re
from importlib import import_module

import pytest

from mlivr_gym.cli.help import GROUPS, CommandParser, output_options
from mlivr_gym.cli.main import every_command, main

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
    assert set(re.findall(r"^  --help (\w+)", text, re.MULTILINE)) == {*GROUPS} - {
        "physics",
        "film",
    }
