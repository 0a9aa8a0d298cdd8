"""The command `mlivr-gym completion`: a shell script that completes commands, options, values."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from mlivr_gym.agents.policy_names import PLANNERS
from mlivr_gym.robot.specification import ROBOTS
from mlivr_gym.world.grasp_map import PLACES

SCRIPT = """\
# Completion of mlivr-gym for bash and zsh; made by `mlivr-gym completion`.
if [ -n "${{ZSH_VERSION-}}" ]; then
    autoload -U +X bashcompinit && bashcompinit
fi
_mlivr_gym() {{
    local current="${{COMP_WORDS[COMP_CWORD]}}" before="${{COMP_WORDS[COMP_CWORD-1]}}" words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{commands}"
    else
        case "${{COMP_WORDS[1]}} $before" in
{cases}
        esac
    fi
    COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _mlivr_gym mlivr-gym
"""
"""Script for both shells; if nothing else fits, file names are completed."""

NAMES = {"--robot": ROBOTS, "--map": PLACES, "--policy": ("pretrained", *PLANNERS)}
"""Names that options know in addition to files."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command to its parser."""
    parser.add_argument("shell", choices=("bash", "zsh"), help="the shell; both get one script")


def run(args: argparse.Namespace) -> None:
    """Print a script with which bash or zsh completes commands, options and values."""
    args.result |= {"script": script(args.commands)}
    print(args.result["script"], end="")


def script(parsers: Mapping[str, argparse.ArgumentParser]) -> str:
    """Return the completion script of the commands with these parsers."""
    cases = []
    for name, parser in parsers.items():
        words: list[str] = []
        for action in parser._actions:  # argparse offers no public access to its options
            names = getattr(getattr(action, "valid", None), "options", ())
            values = tuple(map(str, action.choices or names))
            if not action.option_strings:
                words += values
            for option in action.option_strings:
                values = values or NAMES.get(option, ())
                files = action.metavar in ("FILE", "FOLDER", "PATH")
                if values or files:
                    cases.append(f'            "{name} {option}") words="{" ".join(values)}" ;;')
            words += action.option_strings
        cases.append(f'            "{name} "*) words="{" ".join(words)}" ;;')
    return SCRIPT.format(commands=" ".join(parsers), cases="\n".join(cases))
