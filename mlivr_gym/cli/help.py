"""Help of a command on one screen: the options used most, and the others by group."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from mlivr_gym.errors import SettingError

GROUPS = {
    "robot": (
        "joints, tools, cargo and failures of the robot",
        "locked-joint locked-angle tool-frame package-dir failed-joint cargo allow-touching",
    ),
    "world": (
        "units, boxes and occupied points",
        "unit box occupied unknown gone refusing",
    ),
    "checks": (
        "what stances and steps must keep",
        "no-manipulability no-transitions no-collisions clearance limb-threshold base-threshold",
    ),
    "query": (
        "pose and joints at the start, goal region, price of a regrasp",
        "start-pose start-joints tolerance goal-face regrasp-price",
    ),
    "search": (
        "how a plan is searched for and improved",
        "method heuristic inflation time-limit limit refined",
    ),
    "physics": (
        "controller, disturbances and time steps of a simulation",
        "duration timestep controller physics disturbances seed noise blind",
    ),
    "film": (
        "what is filmed, and how it is drawn",
        "rate film no-film capsules size speed",
    ),
}
"""Groups of options that the help of a command only names: what they are about, and their names.

One that a command has a single option of is no group of it.
"""

GROUP_OF = {f"--{name}": group for group, (_, names) in GROUPS.items() for name in names.split()}


class CommandParser(argparse.ArgumentParser):
    """Parser whose help has the options of one group, at first of those in none of `GROUPS`."""

    def __init__(self, **more: Any) -> None:
        """Take the arguments of `argparse.ArgumentParser`."""
        self._options: dict[str, list[argparse.Action]] = {"": []}
        formatter = argparse.RawDescriptionHelpFormatter
        super().__init__(add_help=False, formatter_class=formatter, **more)
        text = "show this help, or that of a group of options, and exit"
        self.add_argument(
            "-h", "--help", action=_Help, nargs="?", default=argparse.SUPPRESS, metavar="GROUP",
            help=text,
        )  # fmt: skip

    def add_argument(self, *names: Any, **more: Any) -> argparse.Action:
        """Add an option, as `argparse.ArgumentParser` does."""
        action = super().add_argument(*names, **more)
        group = GROUP_OF.get(action.option_strings[-1], "") if action.option_strings else ""
        self._options.setdefault(group, []).append(action)
        return action

    def error(self, message: str) -> NoReturn:
        """Raise a `SettingError` of one line, which says where the usage is explained."""
        raise SettingError(f"{message}; see `{self.prog} --help`")

    def show(self, group: str) -> None:
        """Leave only the options of a group in the help, and name the other groups.

        Raises a `SettingError` if the command has no such group.
        """
        for name in GROUPS:
            if len(self._options.get(name, ())) == 1:
                self._options[""] += self._options.pop(name)
        groups = [name for name in GROUPS if name in self._options]
        if group not in ("", *groups):
            told = f"; it has {', '.join(groups)}" if groups else ""
            raise SettingError(f"`{self.prog}` has no group {group!r} of options{told}")
        for name, actions in self._options.items():
            for action in actions if name != group else ():
                action.help = argparse.SUPPRESS
        given = [str(one.metavar) for one in self._options[""] if not one.option_strings]
        self.usage = self.usage or " ".join(["%(prog)s [OPTION ...]", *given])
        if group:
            self.description, self.epilog = f"Options of the group {group}: {GROUPS[group][0]}.", ""
        elif groups:
            told = "".join(f"  --help {name:<10}{GROUPS[name][0]}\n" for name in groups)
            self.epilog = f"more options:\n{told}\n{self.epilog or ''}"


class _Help(argparse.Action):
    """The option `--help`."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option: object = None,
    ) -> None:
        """Print the help and exit."""
        assert isinstance(parser, CommandParser)
        parser.show(values or "")
        parser.print_help()
        parser.exit()


def output_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of printed output."""
    text = "print one JSON object in place of text, even if the command fails"
    parser.add_argument("--json", action="store_true", help=text)
    text = "print neither text nor progress; errors are still printed"
    parser.add_argument("-q", "--quiet", action="store_true", help=text)
