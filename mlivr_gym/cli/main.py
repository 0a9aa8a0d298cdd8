"""The command `mlivr-gym`."""

from __future__ import annotations

import argparse
import io
import json
import math
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from functools import partial
from importlib import import_module
from typing import Any, NoReturn

import numpy as np

from mlivr_gym import __version__
from mlivr_gym.cli.examples import examples
from mlivr_gym.cli.exits import (
    EXIT_CODES,
    FAILED,
    GRACE,
    INTERRUPTED,
    NO_PLAN,
    REFUSED,
    SUCCESS,
    handle_interrupts,
    print_interrupted,
)
from mlivr_gym.errors import MlivrError, NoPlanError, one_line

COMMANDS = {
    "plan": "plan from a stance to a goal",
    "simulate": "execute a plan in MuJoCo",
    "table1": "the four cases of the paper's Table I",
    "info": "what map, robot and stance graph hold",
    "render": "picture of the scene",
    "view": "look at plans in a browser, and change them there",
    "train": "train a policy",
    "evaluate": "measure a policy or planner",
    "dataset": "write planner episodes as a Minari data set",
    "warmup": "compile for this machine what a first plan needs, and say where it is kept",
    "build": "work out once all that is known of a robot on a map",
    "cache": "list what is kept between runs, limit its size, or clear it",
    "doctor": "what works here: versions, extras, GL, compiled code",
    "completion": "print a script by which bash or zsh completes commands and options",
}
"""What each command does, in the order of the help; the module of its name has the rest."""


class _UsageError(Exception):
    """Arguments that no command understands."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence."""

    def error(self, message: str) -> NoReturn:
        raise _UsageError(one_line(message))


def _parser(given: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of the whole command, with the arguments of those commands that are named.

    Only their modules are imported: others bring in Numba and more, which takes a second.
    """
    parser: argparse.ArgumentParser = _Parser(
        prog="mlivr-gym",
        description="Plan hand-over-hand motion through a space station module.",
        epilog=f"{examples('plan', 'render', 'simulate', 'evaluate')}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(grace=GRACE, json=False, quiet=False)
    parser.add_argument("--version", action="version", version=f"mlivr-gym {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    named = COMMANDS if "completion" in given else {*given}
    for name, told in COMMANDS.items():
        add = partial(commands.add_parser, name, help=told)
        if name in named:
            import_module(f"mlivr_gym.cli.{name}").add_command(add)
        else:
            add()
    for name, added in commands.choices.items():
        added.epilog = examples(name)
        added.formatter_class = argparse.RawDescriptionHelpFormatter
        added.set_defaults(default=added.get_default, commands=commands.choices)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # a file's name need not be text
        sys.stdout.reconfigure(errors="backslashreplace")
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        args = _parser(given).parse_args(given)
    except _UsageError as wrong:
        print(f"mlivr-gym: {wrong}", file=sys.stderr)
        if "--json" in given:  # which the parser has not come to
            _print_json(REFUSED, str(wrong), {})
        return REFUSED
    args.result = {}
    try:
        with redirect_stdout(io.StringIO() if args.json or args.quiet else sys.stdout):
            code, error = _run(args)
        if args.json:
            _print_json(code, error, args.result)
    except BrokenPipeError:
        return FAILED
    return code


def _print_json(code: int, error: str, result: dict[str, Any]) -> None:
    """Print how the command ended as one JSON object."""
    told = {"exit_code": code} | ({"error": error} if error else {}) | result
    print(json.dumps(json_value(told), indent=1), flush=True)


def _run(args: argparse.Namespace) -> tuple[int, str]:
    """Run the command; its exit code, and the error that was told if there was one."""
    try:
        with handle_interrupts(args.grace):
            return args.run(args) or SUCCESS, ""
    except MlivrError as error:
        print(f"mlivr-gym: {one_line(str(error))}", file=sys.stderr)
        return NO_PLAN if isinstance(error, NoPlanError) else REFUSED, one_line(str(error))
    except KeyboardInterrupt as stop:
        print_interrupted(str(stop))
        return INTERRUPTED, str(stop) or "interrupted"


def json_value(value: Any) -> Any:
    """A result as JSON knows it: of NumPy's arrays, of paths, and of numbers that are none."""
    if isinstance(value, dict):
        return {str(name): json_value(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(entry) for entry in value]
    if isinstance(value, np.ndarray | np.generic):
        return json_value(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)


if __name__ == "__main__":
    sys.exit(main())
