"""Errors that the package raises on purpose.

Every one derives from `MlivrError`, so that a caller (the command line is one)
can tell a bad input from a fault of the program.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterable

LONGEST_SHOWN = 400
"""Most characters of a value in a message."""

LONGEST_PATH = 1024
"""Most characters of a path in a message."""

_BRIEF = reprlib.Repr()
_BRIEF.maxstring = _BRIEF.maxother = _BRIEF.maxlong = 80


def shortened(value: object) -> str:
    """A value for a message: short, printable and in one line, whatever it is."""
    try:
        text = one_line(re.sub(r"\s*\n\s*", " ", _BRIEF.repr(value)))
        return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
    except (ValueError, RecursionError):  # whole numbers of thousands of digits, deep nesting
        return f"a {type(value).__name__} too long to show"


def path_shown(path: object) -> str:
    """A path for a message, whole if a file may be called so."""
    text = str(path)
    return repr(text) if len(text) <= LONGEST_PATH else shortened(text)


def one_line(message: str) -> str:
    """A message as one line that every terminal can show."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in message)


class MlivrError(ValueError):
    """Base class: something the caller gave cannot be used."""


class MapError(MlivrError):
    """A map file or map object is faulty."""


class RobotError(MlivrError):
    """A robot description is faulty or cannot be used on the map."""


class ShapeError(MlivrError):
    """A collision shape is faulty."""


class SettingError(MlivrError):
    """A parameter is outside its valid range or choices."""


class GoalError(MlivrError):
    """A goal position is not finite or lies outside the cabin."""


class StanceError(MlivrError):
    """A stance is malformed or cannot be held."""


class PlanError(MlivrError):
    """A plan cannot be found, loaded or used on this map."""


class NoPlanError(PlanError):
    """There is no plan, the start cannot be held, or the limit of the search was reached."""


class SimulationError(MlivrError):
    """A simulation cannot be run as asked."""


class TimingError(SettingError):
    """A step cannot be carried out in the time that is given.

    Attributes
    ----------
    shortest
        The shortest duration that would do [s].
    """

    def __init__(self, duration: float, binding: str, shortest: float) -> None:
        """Build the message.

        Parameters
        ----------
        duration
            The step's duration that was asked for [s].
        binding
            The limit that is broken, and where.
        shortest
            The shortest duration that would do [s].
        """
        self.shortest = shortest
        super().__init__(
            f"a step of {duration:g} s breaks the limit {binding}; "
            f"the shortest that keeps the limits is {shortest:.3f} s"
        )


class SceneError(MlivrError):
    """MuJoCo cannot build the scene of a map and a robot."""


class RenderError(MlivrError):
    """A picture cannot be rendered on this machine."""


class UnknownPointError(StanceError):
    """A point id is not on the map."""

    def __init__(self, point_id: object, valid: Iterable[str]) -> None:
        """Build the message from the id and a sample of the valid ones."""
        ids = list(valid)
        sample = ", ".join(ids[:4])
        super().__init__(
            f"unknown graspable point {shortened(point_id)}: the map has {len(ids)} points, "
            f"for example {sample}"
        )


def choice(name: str, value: object, valid: Iterable[str]) -> str:
    """Return `value` if it is one of `valid`.

    Raises
    ------
    SettingError
        naming the value and the valid choices.
    """
    options = list(valid)
    if value not in options:
        raise SettingError(
            f"{name} is {shortened(value)}; valid choices are {', '.join(map(repr, options))}"
        )
    return str(value)
