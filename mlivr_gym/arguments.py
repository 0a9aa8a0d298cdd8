"""What callers give to public functions: each argument is read by its kind before anything is done.

`checked` stands above a function and takes a table of kinds by name, which the functions of a
chapter share. An argument without a kind is an error when the module is imported.

Example:
    >>> @checked({"cost": Choice(("base", "steps")), "limit": Whole(1, 10)})
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
from mlivr_gym.schema import FieldPath, Kind, Tuples, Whole

P = ParamSpec("P")
T = TypeVar("T")

Kinds = Mapping[str, Kind[Any]]
"""Kind of each argument by name."""

SEED = Whole(0, 2**64 - 1)
"""A seed of random numbers."""

ANY_NUMBER = Tuples()
"""A finite number."""

NOT_NEGATIVE = Tuples((), 0.0)
"""A finite number from 0 on."""


def checked(
    kinds: Kinds, error: type[MlivrError] = SettingError
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Have the arguments of a function read before it is called; it is given what they make of it.

    Parameters
    ----------
    kinds
        Kind of each argument by name; there may be more than the function has. Defaults
        are not read.
    error
        Type of the error.
    """

    def above(function: Callable[P, T]) -> Callable[P, T]:
        signature = inspect.signature(function)
        loose = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
        read = {
            name: kinds[name]
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


class Of:
    """An object of one of some classes."""

    def __init__(self, *classes: type) -> None:
        """Take objects of these classes."""
        self.classes = classes

    def read(self, value: object, place: FieldPath) -> Any:
        """The object."""
        if not isinstance(value, self.classes):
            names = " or ".join(f"a {one.__name__}" for one in self.classes)
            raise place.refused(value, names)
        return value


class Called:
    """Something that can be called, and is no class."""

    def read(self, value: object, place: FieldPath) -> Any:
        """The function."""
        if not callable(value) or isinstance(value, type):
            raise place.refused(value, "a function")
        return value


class FileName:
    """The path of a file; a number would be a file that is open already."""

    def read(self, value: object, place: FieldPath) -> str:
        """The path."""
        path = os.fspath(value) if isinstance(value, (str, os.PathLike)) else None
        if not isinstance(path, str):
            raise place.refused(value, "the path of a file")
        return path


@dataclass(frozen=True)
class Via(Generic[T]):
    """What a function makes of a value and its place."""

    make: Callable[[Any, FieldPath], T]

    def read(self, value: object, place: FieldPath) -> T:
        """What it makes."""
        return self.make(value, place)


@dataclass(frozen=True)
class Raising(Generic[T]):
    """Another kind, with an error of its own."""

    error: type[MlivrError]
    kind: Kind[T]

    def read(self, value: object, place: FieldPath) -> T:
        """What the other kind makes of it."""
        return self.kind.read(value, FieldPath(place.path, self.error))
