"""The command `mlivr-gym`."""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Sequence
from typing import NoReturn

from mlivr_gym import __version__
from mlivr_gym.cli import (
    dataset,
    evaluate,
    info,
    plan,
    render,
    simulate,
    table1,
    train,
    view,
    warmup,
)
from mlivr_gym.cli.arguments import EXAMPLES
from mlivr_gym.cli.exits import (
    EXIT_CODES,
    FAILED,
    GRACE,
    INTERRUPTED,
    NO_PLAN,
    REFUSED,
    prompt_interrupts,
    say_interrupted,
)
from mlivr_gym.errors import MlivrError, NoPlanError, one_line


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence and exits with 2."""

    def error(self, message: str) -> NoReturn:
        self.exit(REFUSED, f"mlivr-gym: {one_line(message)}\n")


def _parser() -> argparse.ArgumentParser:
    """The parser of the whole command."""
    parser: argparse.ArgumentParser = _Parser(
        prog="mlivr-gym",
        description="Plan hand-over-hand motion through a space station module.",
        epilog=f"{EXAMPLES}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(grace=GRACE)
    parser.add_argument("--version", action="version", version=f"mlivr-gym {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in (plan, simulate, table1, info, render, view, train, evaluate, dataset, warmup):
        command.add_command(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # a file's name need not be text
        sys.stdout.reconfigure(errors="backslashreplace")
    args = _parser().parse_args(arguments)
    try:
        with prompt_interrupts(args.grace):
            code: int = args.run(args)
    except MlivrError as error:
        print(f"mlivr-gym: {one_line(str(error))}", file=sys.stderr)
        return NO_PLAN if isinstance(error, NoPlanError) else REFUSED
    except KeyboardInterrupt as stop:
        say_interrupted(str(stop))
        return INTERRUPTED
    except BrokenPipeError:
        return FAILED
    return code


if __name__ == "__main__":
    sys.exit(main())
