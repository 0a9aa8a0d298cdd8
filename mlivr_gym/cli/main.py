"""The command `mlivr-gym`: parse its arguments, run one of its subcommands and report the end."""

from __future__ import annotations

import argparse
import inspect
import io
import json
import math
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from importlib import import_module
from typing import Any

import numpy as np

from mlivr_gym import __version__
from mlivr_gym._interrupts import (
    CLEAR_LINE,
    INTERRUPTED,
    is_command,
    set_grace,
    silence,
    was_interrupted,
)
from mlivr_gym.cli.commands import COMMANDS
from mlivr_gym.cli.exits import EXIT_CODES, FAILED, GRACE, NO_PLAN, REFUSED, SUCCESS
from mlivr_gym.cli.help import CommandParser, output_options
from mlivr_gym.errors import MlivrError, NoPlanError, one_line
from mlivr_gym.extensions import commands

SHOWN = ("plan", "render", "simulate", "evaluate")
"""Commands whose examples the help of the program shows."""


def every_command() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return the module of each command, and its help line with examples."""
    core = {name: (f"mlivr_gym.cli.{name}", lines) for name, lines in COMMANDS.items()}
    return core | commands()


def examples(lines: Sequence[str]) -> str:
    """Return example command lines as the last paragraph of a help text."""
    return "examples:\n" + "".join(f"  {line}\n" for line in lines)


def _parser(given: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser of all commands, with the options of those that `given` names.

    Only the modules of these are imported, since importing Numba and others takes a second.
    """
    shown = [line for name in SHOWN for line in COMMANDS[name][1:]]
    parser: argparse.ArgumentParser = CommandParser(
        prog="mlivr-gym",
        usage="%(prog)s COMMAND [OPTION ...]",
        description="Plan, simulate and learn how a robot with several limbs climbs hand over "
        "hand through a space station module.",
        epilog=f"{examples(shown)}\n{EXIT_CODES}",
    )
    # `grace`, and `default` and `commands` below, are no options but values for the commands:
    # the time to end after Ctrl-C, a function of an option's name, and all parsers by name.
    parser.set_defaults(grace=GRACE, json=False, quiet=False)
    parser.add_argument("--version", action="version", version=f"mlivr-gym {__version__}")
    choices = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", prog="mlivr-gym"
    )
    for name, (place, (summary, *lines)) in every_command().items():
        added = choices.add_parser(name, help=summary, epilog=examples(lines))
        added.set_defaults(default=added.get_default, commands=choices.choices)
        if name in given:
            module = import_module(place)
            added.description = inspect.getdoc(module.run)
            added.set_defaults(run=module.run)
            if hasattr(module, "add_options"):
                module.add_options(added)
            output_options(added)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line, by default that of `sys.argv`, and return one of the `EXIT_CODES`."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # file names may not be valid text
        sys.stdout.reconfigure(errors="backslashreplace")
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        code = _run_line(given)
        sys.stdout.flush()
    except BrokenPipeError:
        return FAILED
    except KeyboardInterrupt:
        _print_interrupted()
        code = INTERRUPTED
    finally:
        set_grace(0.0)
    if code == INTERRUPTED and is_command():
        silence()
    return code


def _run_line(given: Sequence[str]) -> int:
    """Run a command line, and return its exit code."""
    try:
        args, unknown = _parser(given).parse_known_args(given)
        if unknown:
            args.commands[args.command].error(f"unrecognized arguments: {' '.join(unknown)}")
    except MlivrError as error:
        print(f"mlivr-gym: {error}", file=sys.stderr)
        if "--json" in given:  # the parser may have stopped before this option
            _print_json(REFUSED, str(error), {})
        return REFUSED
    except Exception as error:
        _fault_of_machine(error)
        return FAILED
    args.result = {}
    with redirect_stdout(io.StringIO() if args.json or args.quiet else sys.stdout):
        code, message = _run(args)
    if args.json:
        _print_json(code, message, args.result)
    return code


def _print_json(code: int, error: str, result: dict[str, Any]) -> None:
    """Print exit code, error message and result of a command as one JSON object."""
    fields = {"exit_code": code} | ({"error": error} if error else {}) | result
    print(json.dumps(json_value(fields), indent=1), flush=True)


def _run(args: argparse.Namespace) -> tuple[int, str]:
    """Run a command and return its exit code and the error message that it printed, or `""`."""
    try:
        set_grace(args.grace)
        return args.run(args) or SUCCESS, ""
    except MlivrError as error:
        print(f"mlivr-gym: {error}", file=sys.stderr)
        return NO_PLAN if isinstance(error, NoPlanError) else REFUSED, str(error)
    except (Exception, KeyboardInterrupt) as stop:
        # Libraries make other errors of an interruption, such as one of a missing compiled object.
        if not isinstance(stop, KeyboardInterrupt) and not was_interrupted():
            return FAILED, _fault_of_machine(stop)
        reason = str(stop) if isinstance(stop, KeyboardInterrupt) else ""
        _print_interrupted(reason)
        return INTERRUPTED, reason or "interrupted"


def _print_interrupted(reason: str = "") -> None:
    """Print that the command was interrupted, in place of a progress line on a terminal."""
    start = CLEAR_LINE if sys.stderr.isatty() else ""
    print(f"{start}mlivr-gym: {reason or 'interrupted'}", file=sys.stderr, flush=True)


def _fault_of_machine(error: Exception) -> str:
    """Print that memory is short or another package is broken; raise any other error."""
    told = ("failed to map segment", "cannot allocate memory", "can't start new thread")
    if isinstance(error, MemoryError) or any(one in str(error).lower() for one in told):
        message = "the memory that this process may use is not enough; allow more (see `ulimit -v`)"
    elif type(error) is ImportError and not (error.name or "").startswith("mlivr_gym"):
        message = f"{one_line(str(error))}; `mlivr-gym doctor` tells what is wrong with packages"
    else:
        raise error
    print(f"mlivr-gym: {message}", file=sys.stderr)
    return message


def json_value(value: Any) -> Any:
    """Convert a result to types of JSON: arrays to lists, paths to strings, NaN to None."""
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
