"""The command `mlivr-gym`."""

from __future__ import annotations

import argparse
import io
import json
import math
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from typing import Any, NoReturn

import numpy as np

from mlivr_gym import __version__
from mlivr_gym.cli import (
    build,
    cache,
    completion,
    dataset,
    doctor,
    evaluate,
    info,
    plan,
    render,
    roadmap,
    simulate,
    table1,
    train,
    view,
    warmup,
)
from mlivr_gym.cli.examples import examples
from mlivr_gym.cli.exits import (
    EXIT_CODES,
    FAILED,
    GRACE,
    INTERRUPTED,
    NO_PLAN,
    REFUSED,
    SUCCESS,
    prompt_interrupts,
    say_interrupted,
)
from mlivr_gym.errors import MlivrError, NoPlanError, one_line

COMMANDS = (
    plan,
    simulate,
    table1,
    info,
    render,
    view,
    train,
    evaluate,
    dataset,
    warmup,
    build,
    roadmap,
    cache,
    doctor,
    completion,
)
"""The module of each command, in the order of the help."""


class _UsageError(Exception):
    """Arguments that no command understands."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence."""

    def error(self, message: str) -> NoReturn:
        raise _UsageError(one_line(message))


def _parser() -> argparse.ArgumentParser:
    """The parser of the whole command."""
    parser: argparse.ArgumentParser = _Parser(
        prog="mlivr-gym",
        description="Plan hand-over-hand motion through a space station module.",
        epilog=f"{examples('plan', 'render', 'simulate', 'evaluate')}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(grace=GRACE, json=False, quiet=False)
    parser.add_argument("--version", action="version", version=f"mlivr-gym {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add_command(commands)
    for name, added in commands.choices.items():
        added.epilog = examples(name)
        added.formatter_class = argparse.RawDescriptionHelpFormatter
        added.set_defaults(default=added.get_default, parser=parser)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # a file's name need not be text
        sys.stdout.reconfigure(errors="backslashreplace")
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        args = _parser().parse_args(given)
    except _UsageError as wrong:
        print(f"mlivr-gym: {wrong}", file=sys.stderr)
        if "--json" in given:  # which the parser has not come to
            _tell_json(REFUSED, str(wrong), {})
        return REFUSED
    args.result = {}
    try:
        with redirect_stdout(io.StringIO() if args.json or args.quiet else sys.stdout):
            code, error = _run(args)
        if args.json:
            _tell_json(code, error, args.result)
    except BrokenPipeError:
        return FAILED
    return code


def _tell_json(code: int, error: str, result: dict[str, Any]) -> None:
    """Print how the command ended as one JSON object."""
    told = {"exit_code": code} | ({"error": error} if error else {}) | result
    print(json.dumps(plain(told), indent=1), flush=True)


def _run(args: argparse.Namespace) -> tuple[int, str]:
    """Run the command; its exit code, and the error that was told if there was one."""
    try:
        with prompt_interrupts(args.grace):
            return args.run(args) or SUCCESS, ""
    except MlivrError as error:
        print(f"mlivr-gym: {one_line(str(error))}", file=sys.stderr)
        return NO_PLAN if isinstance(error, NoPlanError) else REFUSED, one_line(str(error))
    except KeyboardInterrupt as stop:
        say_interrupted(str(stop))
        return INTERRUPTED, str(stop) or "interrupted"


def plain(value: Any) -> Any:
    """A result as JSON knows it: of NumPy's arrays, of paths, and of numbers that are none."""
    if isinstance(value, dict):
        return {str(name): plain(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)


if __name__ == "__main__":
    sys.exit(main())
