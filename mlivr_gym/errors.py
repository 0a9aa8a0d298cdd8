"""Errors that the package raises when a caller gives something that cannot be used.

They all derive from `MlivrError`, so that a caller, for example the command line, can distinguish
invalid input from a fault of the program.
"""

from __future__ import annotations

import copyreg
import re
import reprlib
from collections.abc import Iterable
from typing import Any

LONGEST_SHOWN = 400
"""Maximum number of characters of a value in a message."""

LONGEST_PATH = 1024
"""Maximum number of characters of a path in a message."""

_BRIEF = reprlib.Repr()
_BRIEF.maxstring = _BRIEF.maxother = _BRIEF.maxlong = 80


def shortened(value: object) -> str:
    """Return a value as short, printable text on one line, for an error message."""
    try:
        text = one_line(re.sub(r"\s*\n\s*", " ", _BRIEF.repr(value)))
        return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
    except (ValueError, RecursionError):  # an integer of thousands of digits, or deep nesting
        return f"a {type(value).__name__} too long to show"


def path_shown(path: object) -> str:
    """Return a path for an error message, in full if it is short enough to be that of a file."""
    text = str(path)
    return repr(text) if len(text) <= LONGEST_PATH else shortened(text)


def one_line(message: str) -> str:
    """Return a message with every unprintable character escaped, so that it fits on one line."""
    if message.isprintable():
        return message
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in message)


class MlivrError(ValueError):
    """Base class of all errors of the package: an input cannot be used."""

    def __init__(self, message: str = "") -> None:
        """Escape what is unprintable: files and other libraries are quoted, on terminals too."""
        super().__init__(one_line(message))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy message and attributes, since constructors may take something else."""
        return copyreg.__newobj__, (type(self), *self.args), vars(self)  # type: ignore[attr-defined]


class MapError(MlivrError):
    """A map file or a map object is faulty."""


class RobotError(MlivrError):
    """A robot description is faulty, or the robot cannot be used on the map."""


class ShapeError(MlivrError):
    """A collision shape is faulty."""


class SettingError(MlivrError):
    """A parameter is outside its valid range or is not one of its valid choices."""


class GoalError(MlivrError):
    """A goal position is not finite or lies outside the cabin."""


class StanceError(MlivrError):
    """A stance is malformed or cannot be held."""


class PlanError(MlivrError):
    """A plan cannot be found, cannot be loaded, or cannot be used on this map."""


class NoPlanError(PlanError):
    """No plan exists, the start cannot be held, or the search reached its limit."""


class SimulationError(MlivrError):
    """A simulation cannot be run as requested."""


class TimingError(SettingError):
    """A step cannot be carried out in the given time.

    Attributes
    ----------
    shortest
        Shortest duration that keeps all limits [s].
    """

    def __init__(self, duration: float, binding: str, shortest: float) -> None:
        """Build the message.

        The requested duration of the step [s] violates the limit that `binding` names, with its
        place; the shortest duration [s] keeps all limits.
        """
        self.shortest = shortest
        super().__init__(
            f"a step of {duration:g} s breaks the limit {binding}; "
            f"the shortest duration that keeps all limits is {shortest:.3f} s"
        )


class SceneError(MlivrError):
    """MuJoCo cannot build the scene of a map and a robot."""


class RenderError(MlivrError):
    """A picture cannot be rendered on this machine."""


class UnknownPointError(StanceError):
    """No graspable point of the map has the given id."""

    def __init__(self, point_id: object, valid: Iterable[str]) -> None:
        """Build the message from the unknown id and a sample of the valid ones."""
        ids = list(valid)
        sample = ", ".join(ids[:4])
        super().__init__(
            f"unknown graspable point {shortened(point_id)}: the map has {len(ids)} points, "
            f"for example {sample}"
        )


def choice(name: str, value: object, valid: Iterable[str]) -> str:
    """Return `value` if it is one of the valid choices.

    Raises a `SettingError` that names the value and the valid choices if it is not.
    """
    options = list(valid)
    if value not in options:
        raise SettingError(
            f"{name} is {shortened(value)}; valid choices are {', '.join(map(repr, options))}"
        )
    return str(value)
