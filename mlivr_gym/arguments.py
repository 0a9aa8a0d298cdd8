"""Checks of the arguments of public functions, made before anything is computed.

The decorator `checked` takes a schema `Validator` for each argument by name; the functions of a
package share one such table. An argument without a validator is an error when the module is
imported. The validators for data are in `schema`; this module adds those that only arguments need,
such as objects of a class and file names.

Examples
--------
>>> from mlivr_gym.schema import Choice
>>> @checked({"cost": Choice(("base", "steps")), "limit": Integer(1, 10)})
... def search(cost: str, *, limit: int = 10) -> int:
...     return limit
>>> search("time")
Traceback (most recent call last):
mlivr_gym.errors.SettingError: cost is 'time'; valid choices are 'base', 'steps'
"""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, ParamSpec, TypeVar

from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.schema import FieldPath, Integer, Tuples, Validator

P = ParamSpec("P")
T = TypeVar("T")

Validators = Mapping[str, Validator[Any]]
"""Validator of each argument by name."""

SEED = Integer(0, 2**64 - 1)
"""Validator of a seed of random numbers."""

ANY_NUMBER = Tuples()
"""Validator of any finite number."""

NOT_NEGATIVE = Tuples((), 0.0)
"""Validator of a finite number that is at least 0."""


def checked(
    validators: Validators, error: type[MlivrError] = SettingError
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that checks and converts the arguments of a function before each call.

    `validators` are those of the arguments by name, more than the function takes perhaps; default
    values are not checked. `error` is the type of the error that an invalid argument raises.
    """

    def above(function: Callable[P, T]) -> Callable[P, T]:
        signature = inspect.signature(function)
        loose = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
        read = {
            name: validators[name]
            for name, parameter in signature.parameters.items()
            if name not in ("self", "cls") and parameter.kind not in loose
        }

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> T:
            bound = signature.bind(*args, **kwargs)
            for name, value in bound.arguments.items():
                if name in read:
                    bound.arguments[name] = read[name].read(value, FieldPath(name, error))
            return function(*bound.args, **bound.kwargs)

        return call

    return above


class InstanceOf:
    """Validator of an object that is an instance of one of some classes."""

    def __init__(self, *classes: type) -> None:
        """Accept instances of these classes."""
        self.classes = classes

    def read(self, value: object, place: FieldPath) -> Any:
        """Return the object itself."""
        if not isinstance(value, self.classes):
            names = " or ".join(f"a {one.__name__}" for one in self.classes)
            raise place.refused(value, names)
        return value


class Function:
    """Validator of a function or another callable object; a class is refused."""

    def read(self, value: object, place: FieldPath) -> Any:
        """Return the callable itself."""
        if not callable(value) or isinstance(value, type):
            raise place.refused(value, "a function")
        return value


class FileName:
    """Validator of a file path.

    A whole number is refused, since `open` would take it for the descriptor of an open file.
    """

    def read(self, value: object, place: FieldPath) -> str:
        """Return the path as text."""
        path = os.fspath(value) if isinstance(value, (str, os.PathLike)) else None
        if not isinstance(path, str):
            raise place.refused(value, "the path of a file")
        return path


@dataclass(frozen=True)
class Reader(Generic[T]):
    """Validator whose values are read by a function."""

    make: Callable[[Any, FieldPath], T]
    """Function that converts a value and its `FieldPath`, or raises an error."""

    def read(self, value: object, place: FieldPath) -> T:
        """Return what the function makes of the value."""
        return self.make(value, place)


@dataclass(frozen=True)
class WithError(Generic[T]):
    """Another kind that raises a different type of error."""

    error: type[MlivrError]
    """Type of the error."""
    kind: Validator[T]
    """The kind that reads the value."""

    def read(self, value: object, place: FieldPath) -> T:
        """Return the value as the wrapped kind reads it."""
        return self.kind.read(value, FieldPath(place.path, self.error))
