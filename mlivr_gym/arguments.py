"""Checks of the arguments of public functions, made before anything is computed.

The decorator `checked` takes a schema `Validator` for some arguments by name; the functions of a
package share one such table. The others are checked by their annotations, see `validator_of`. The
validators for data are in `schema`; this module adds those that only arguments need, such as
objects of a class and file names.

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
import operator
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Generic,
    ParamSpec,
    TypeVar,
    Union,
    get_args,
    get_origin,
    is_typeddict,
)

import numpy as np

from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.schema import (
    Anything,
    FieldPath,
    Flag,
    Integer,
    ListOf,
    OrNone,
    Text,
    Tuples,
    Validator,
)
from mlivr_gym.values import MAX_POINTS, MAX_REMARK_LENGTH

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
    validators: Validators = MappingProxyType({}),
    error: type[MlivrError] = SettingError,
    *,
    late: bool = False,
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Return a decorator that checks and converts the arguments of a function before each call.

    `validators` are those of some arguments by name, more than the function takes perhaps; the
    others are those of their annotations. Default values are not checked. `error` is the type of
    the error that an invalid argument raises. With `late`, for short functions that are called
    very often, arguments are checked only after the function has failed, and not converted.
    """

    def above(function: Callable[P, T]) -> Callable[P, T]:
        signature = inspect.signature(function)
        loose = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
        given = {
            name: parameter.annotation
            for name, parameter in signature.parameters.items()
            if name not in ("self", "cls") and parameter.kind not in loose
        }

        @functools.cache  # made at the first call, when all names of the module are defined
        def kinds() -> Validators:
            read = dict(validators)
            for name, annotation in given.items():
                if name not in read:
                    read[name] = validator_of(eval(annotation, function.__globals__))
            return {name: read[name] for name in given}

        def converted(*args: P.args, **kwargs: P.kwargs) -> inspect.BoundArguments:
            bound, read = signature.bind(*args, **kwargs), kinds()
            for name, value in bound.arguments.items():
                if name in read:
                    bound.arguments[name] = read[name].read(value, FieldPath(name, error))
            return bound

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> T:
            bound = converted(*args, **kwargs)
            return function(*bound.args, **bound.kwargs)

        @functools.wraps(function)
        def call_first(*args: P.args, **kwargs: P.kwargs) -> T:
            try:
                return function(*args, **kwargs)
            except MlivrError:  # the function has told it in its own words
                raise
            except Exception:
                converted(*args, **kwargs)
                raise

        return call_first if late else call

    return above


def validator_of(annotation: Any) -> Validator[Any]:
    """Return the validator of what an annotation stands for.

    It is the one with which a type is `Annotated`. Numbers are finite, and arrays have any shape,
    as those of `arrays`; an array of truth values or of integers is one that NumPy made. Of several
    types only classes and None may be alternatives, and sequences beside arrays.
    """
    annotation = _resolved(annotation)
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        kind: Validator[Any] = annotation.__metadata__[0]
        return kind
    if annotation in SIMPLE:
        return SIMPLE[annotation]
    if origin in (Union, UnionType):
        rest = [_resolved(one) for one in parts if one is not NoneType]
        arrays = [one for one in rest if get_origin(one) is np.ndarray]
        one = arrays[0] if arrays else functools.reduce(operator.or_, rest)
        if len(rest) < len(parts):
            return OrNone(validator_of(one))
        return validator_of(one) if arrays else InstanceOf(*rest)
    if origin is np.ndarray:
        return ArrayOf(np.dtype(get_args(parts[1])[0]).kind)
    if origin is tuple and parts[1:] != (Ellipsis,):
        return TupleOf(tuple(map(validator_of, parts)))
    if origin in (tuple, list, Sequence, Iterable):
        return ListOf(validator_of(parts[0]), most=MAX_POINTS)
    if origin is Callable:
        return Function()
    if is_typeddict(annotation):
        return InstanceOf(dict)
    return InstanceOf(origin or annotation)


def _resolved(annotation: Any) -> Any:
    """Return the type that an alias stands for; `NDArray` is one from NumPy 2.5 on."""
    meant, parts = getattr(annotation, "__value__", None), get_args(annotation)
    return annotation if meant is None else meant[parts] if parts else meant


@dataclass(frozen=True)
class ArrayOf:
    """Validator of an array of any shape, or of nested lists."""

    kind: str
    """Its numbers by NumPy's letter: "f", finite ones, "i" or "u", integers, or "b"."""

    def read(self, value: object, place: FieldPath) -> Any:
        """Return the array; integers are floats in an array of these."""
        names = {"f": "finite numbers", "b": "truth values"}
        wanted = {"f": "fiu", "b": "b"}.get(self.kind, "iu")
        kind = f"an array of {names.get(self.kind, 'integers')}"
        try:
            found = np.asarray(value) if isinstance(value, (list, tuple, np.ndarray)) else None
        except (TypeError, ValueError, OverflowError):  # rows of different lengths
            found = None
        if found is not None and not found.size and found.dtype.kind == "f":
            found = found.astype(f"{self.kind}8" if self.kind in "fiu" else "?")
        if found is None or found.dtype.kind not in wanted or not np.isfinite(found).all():
            raise place.refused(value, kind)
        return found.astype(np.float64) if self.kind == "f" else found


@dataclass(frozen=True)
class TupleOf:
    """Validator of a list with one entry for each of some kinds."""

    kinds: tuple[Validator[Any], ...]
    """Validator of each entry."""

    def read(self, value: object, place: FieldPath) -> tuple[Any, ...]:
        """Return the entries as a tuple."""
        entries = ListOf(Anything(), len(self.kinds), len(self.kinds)).read(value, place)
        both = zip(self.kinds, entries, strict=True)
        return tuple(kind.read(one, place.entry(k)) for k, (kind, one) in enumerate(both))


class InstanceOf:
    """Validator of an object that is an instance of one of some classes.

    In place of a class there may be an interface, whose methods the object must have.
    """

    def __init__(self, *classes: type) -> None:
        """Accept instances of these classes."""
        self.classes = classes

    def read(self, value: object, place: FieldPath) -> Any:
        """Return the object itself."""
        for kind in self.classes:
            names = _methods(kind)
            is_one = all(hasattr(value, name) for name in names) and not isinstance(value, type)
            if is_one if names else isinstance(value, kind):
                return value
        told = (" with ".join([f"a {one.__name__}", *_methods(one)]) for one in self.classes)
        raise place.refused(value, " or ".join(told))


def _methods(kind: type) -> list[str]:
    """Return the names of the methods of an interface, none of a class."""
    names = vars(kind) if getattr(kind, "_is_protocol", False) else ()
    return [name for name in names if not name.startswith("_") or name == "__call__"]


class Function:
    """Validator of a function or another callable object; a class is refused."""

    def read(self, value: object, place: FieldPath) -> Any:
        """Return the callable itself."""
        if not callable(value) or isinstance(value, type):
            raise place.refused(value, "a function")
        return value


def is_file_name(path: str) -> bool:
    """Return whether the system can have a file of this name: without NUL and lone surrogates."""
    try:
        return b"\0" not in os.fsencode(path)
    except UnicodeEncodeError:
        return False


class FileName:
    """Validator of a file path.

    A whole number is refused, since `open` would take it for the descriptor of an open file.
    """

    def read(self, value: object, place: FieldPath) -> str:
        """Return the path as text."""
        path = os.fspath(value) if isinstance(value, (str, os.PathLike)) else None
        if not isinstance(path, str) or not is_file_name(path):
            raise place.refused(value, "the path of a file")
        return path


SIMPLE: Mapping[Any, Validator[Any]] = {
    Any: Anything(),
    object: Anything(),
    bool: Flag(),
    int: Integer(-(2**63), 2**63 - 1),
    float: ANY_NUMBER,
    str: Text(0, MAX_REMARK_LENGTH),
    Path: FileName(),
    str | Path: FileName(),
}
"""Validator of each type that is no class of the package."""


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
