"""Schemas: which fields data from outside have, and of what kind each of them is.

Everything that is read from a file or given as plain data goes through one: maps, robots, boxes,
plans, settings, hyperparameters. A schema is a `Kind`; kinds of objects and lists are made of other
kinds. `read` walks the data and either returns what the program works with or raises one error,
which names the place (`points[3].normal[0]`), the value found there and what it must be.

Example:
    >>> from mlivr_gym.errors import MapError
    >>> rail = Fields({"id": NAME, "ends": Numbers((2, 3), most=1000.0, unit="m")})
    >>> rail.read({"id": "R", "ends": [[0, 0, 0], [1, 0, "x"]]}, Place("", MapError))
    Traceback (most recent call last):
    mlivr_gym.errors.MapError: ends is [[0, 0, 0], [1, 0, 'x']]; it must be numbers of shape (2, 3)
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass
from functools import cached_property
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.errors import MlivrError, shortened
from mlivr_gym.values import LONGEST_TEXT, MOST_PARTS, numbers

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)

ROTATION_TOLERANCE = 1e-5
"""Largest deviation of a rotation matrix times its transpose from the unit matrix."""


class FieldPath(NamedTuple):
    """Where a value stands, for the message, and the type of the error."""

    path: str
    error: type[MlivrError]

    def field(self, name: str) -> FieldPath:
        """The place of a field of the object that stands here."""
        return FieldPath(f"{self.path}.{name}" if self.path else name, self.error)

    def entry(self, number: int) -> FieldPath:
        """The place of an entry of the list that stands here."""
        return FieldPath(f"{self.path}[{number}]", self.error)

    def fault(self, told: str) -> MlivrError:
        """The error that says something of what stands here."""
        return self.error(f"{self.path or 'the data'} {told}")

    def refused(self, value: object, kind: str) -> MlivrError:
        """The error that shows the value and says what it must be."""
        return self.fault(f"is {shortened(value)}; it must be {kind}")

    def build(self, make: Callable[..., T], *args: Any, **options: Any) -> T:
        """What a constructor makes of checked values; its error is told with the place."""
        try:
            return make(*args, **options)
        except MlivrError as fault:
            raise self.error(f"{self.path}: {fault}" if self.path else str(fault)) from None


class Kind(Protocol[T_co]):
    """A kind of value."""

    def read(self, value: object, place: FieldPath) -> T_co:
        """What the program works with.

        Parameters
        ----------
        value
            What was given.
        place
            Where it stands.

        Raises
        ------
        MlivrError
            of the type of the place, if it is not of this kind.
        """


class Anything:
    """A remark in a file, which nobody reads."""

    def read(self, value: object, place: FieldPath) -> object:
        """The value as it is."""
        return value


@dataclass(frozen=True)
class Text:
    """Printable text.

    Attributes
    ----------
    least
        Fewest characters.
    """

    least: int = 1

    def read(self, value: object, place: FieldPath) -> str:
        """The text; half of a surrogate pair, for example, could not be written."""
        if (
            not isinstance(value, str)
            or not self.least <= len(value) <= LONGEST_TEXT
            or not value.isprintable()
        ):
            kind = f"a text of {self.least} to {LONGEST_TEXT} printable characters"
            raise place.refused(value, kind)
        return value


class Flag:
    """True or false."""

    def read(self, value: object, place: FieldPath) -> bool:
        """The switch."""
        if not isinstance(value, (bool, np.bool_)):
            raise place.refused(value, "true or false")
        return bool(value)


@dataclass(frozen=True)
class Choice:
    """One of several names."""

    options: tuple[str, ...]

    def read(self, value: object, place: FieldPath) -> str:
        """The name."""
        if not isinstance(value, str) or value not in self.options:
            told = f"is {shortened(value)}; valid choices are {', '.join(map(repr, self.options))}"
            raise place.fault(told + meant(value, self.options))
        return str(value)


@dataclass(frozen=True)
class Whole:
    """A whole number from `least` to `most`."""

    least: int
    most: int

    def read(self, value: object, place: FieldPath) -> int:
        """The number."""
        if (
            isinstance(value, bool)
            or not isinstance(value, (int, np.integer))
            or not self.least <= value <= self.most
        ):
            raise place.refused(value, f"a whole number from {self.least} to {self.most}")
        return int(value)


@dataclass(frozen=True)
class Numbers:
    """Finite numbers in lists of a shape.

    Attributes
    ----------
    shape
        The shape; a first entry of None leaves the number of rows open.
    least
        Least value of each.
    most
        Largest value of each.
    unit
        The unit; lengths [m] above `most` are told to be in metres.
    rows
        Fewest and most rows, where their number is open.
    """

    shape: tuple[int | None, ...] = ()
    least: float = -np.inf
    most: float = np.inf
    unit: str = ""
    rows: tuple[int, int] = (1, MOST_PARTS)

    def read(self, value: object, place: FieldPath) -> Array:
        """The numbers as an array of floats."""
        count = len(_list(value, place, *self.rows)) if None in self.shape else 0
        shape = tuple(count if size is None else size for size in self.shape)
        if 0 in shape:
            return np.zeros(shape)
        most = self.most if self.unit == "m" else np.inf
        found = numbers(value, shape, place.path, place.error, most)
        wrong = (found < self.least) | (found > self.most)
        if wrong.any():
            first = np.unravel_index(int(wrong.argmax()), shape)
            for index in first:
                place = place.entry(int(index))
            raise place.refused(float(found[first]), self._range())
        return found

    def _range(self) -> str:
        """The range in words."""
        unit = f" {self.unit}" if self.unit else ""
        if self.most == np.inf:
            return f"at least {self.least:g}{unit}"
        return f"from {self.least:g} to {self.most:g}{unit}"


@dataclass(frozen=True)
class Tuples(Numbers):
    """The same as nested tuples, a single number as a float."""

    def read(self, value: object, place: FieldPath) -> Any:
        """The numbers."""
        return _frozen(super().read(value, place).tolist())


class Rotation:
    """A right-handed rotation matrix, as rows."""

    def read(self, value: object, place: FieldPath) -> Any:
        """The rows, three tuples of three."""
        found = numbers(value, (3, 3), place.path, place.error)
        if not are_rotations(found).all():
            raise place.fault("must be a right-handed rotation matrix")
        return _frozen(found.tolist())


def are_rotations(turns: Array) -> BoolArray:
    """Which of some matrices are right-handed rotations.

    Parameters
    ----------
    turns
        The matrices, shape (..., 3, 3).
    """
    turned = np.clip(turns, -2.0, 2.0)  # squares of huge numbers would overflow
    error = np.abs(np.swapaxes(turned, -1, -2) @ turned - np.eye(3)).max(axis=(-2, -1))
    right: BoolArray = (error <= ROTATION_TOLERANCE) & (np.linalg.det(turned) > 0.0)
    return right


@dataclass(frozen=True)
class Maybe(Generic[T]):
    """Another kind, or none."""

    kind: Kind[T]

    def read(self, value: object, place: FieldPath) -> T | None:
        """What the other kind makes of it, or None."""
        return None if value is None else self.kind.read(value, place)


@dataclass(frozen=True)
class Listed(Generic[T]):
    """A list of another kind, of `least` to `most` entries."""

    kind: Kind[T]
    least: int = 0
    most: int = MOST_PARTS

    def read(self, value: object, place: FieldPath) -> tuple[T, ...]:
        """What the other kind makes of each entry."""
        listed = _list(value, place, self.least, self.most)
        return tuple(self.kind.read(entry, place.entry(k)) for k, entry in enumerate(listed))


@dataclass(frozen=True)
class Fields:
    """An object with fields.

    Attributes
    ----------
    required
        Kind of each field that must be there.
    optional
        Kind of each that may be there.
    others
        Whether it may have more, of any kind.
    """

    required: Mapping[str, Kind[Any]]
    optional: Mapping[str, Kind[Any]] = dataclasses.field(default_factory=dict)
    others: bool = False

    @cached_property
    def _kinds(self) -> dict[str, Kind[Any]]:
        return {**self.required, **self.optional}

    def read(self, value: object, place: FieldPath) -> dict[str, Any]:
        """What the kinds make of the fields that are there."""
        known = ", ".join(self._kinds)
        if not isinstance(value, dict):
            raise place.refused(value, f"an object with {known}")
        for name in value:
            if name not in self._kinds and not self.others:
                hint = meant(name, self._kinds)
                told = f"has an unknown field {shortened(name)}; valid fields are {known}{hint}"
                raise place.fault(told)
        found = {
            name: self._kinds[name].read(entry, place.field(name)) if name in self._kinds else entry
            for name, entry in value.items()
        }
        for name in self.required:
            if name not in found:
                raise place.field(name).fault("is missing")
        return found


@dataclass(frozen=True)
class Struct(Generic[T]):
    """An object with the fields of a dataclass.

    Attributes
    ----------
    made
        The dataclass.
    kinds
        Kind of each field.
    complete
        Whether fields that have a default must be there too.
    """

    made: type[T]
    kinds: Mapping[str, Kind[Any]]
    complete: bool = False

    @cached_property
    def fields(self) -> Fields:
        """The fields of plain data."""
        missing: dict[str, Kind[Any]] = {}
        optional: dict[str, Kind[Any]] = {}
        for entry in dataclasses.fields(self.made):  # type: ignore[arg-type]
            needed = entry.default is MISSING and entry.default_factory is MISSING
            if entry.name in self.kinds:
                part = missing if needed or self.complete else optional
                part[entry.name] = self.kinds[entry.name]
        return Fields(missing, optional)

    def read(self, value: object, place: FieldPath) -> T:
        """The record of plain data, or a record as it is."""
        if isinstance(value, self.made):
            return value
        return place.build(self.made, **self.fields.read(value, place))

    def given(self, value: object, place: FieldPath, known: Mapping[str, T] | None = None) -> T:
        """The record as it is, of plain data, by name, or, of None, with all its defaults.

        Parameters
        ----------
        value
            What was given.
        place
            Where it stands.
        known
            Records that have names.
        """
        if isinstance(value, str) and known is not None:
            return known[Choice(tuple(known)).read(value, place)]
        return self.read({} if value is None else value, place)

    def check(self, record: T, place: FieldPath) -> None:
        """Check the fields of a record that is being made, and keep what their kinds make of them.

        Raises
        ------
        MlivrError
            of the type of the place, naming the field.
        """
        for name, kind in self.kinds.items():
            found = kind.read(getattr(record, name), place.field(name))
            object.__setattr__(record, name, found)


NAME = Text()
"""A name: printable text, not empty."""


def meant(value: object, valid: Iterable[str]) -> str:
    """What may have been meant by a name that is not valid, as the end of a message."""
    nearest = (
        difflib.get_close_matches(value[:LONGEST_TEXT], valid, 1) if isinstance(value, str) else []
    )
    return f"; did you mean {nearest[0]!r}?" if nearest else ""


def _list(value: object, place: FieldPath, least: int, most: int) -> Any:
    if not isinstance(value, (list, tuple)) and not (isinstance(value, np.ndarray) and value.ndim):
        raise place.refused(value, "a list")
    if not least <= len(value) <= most:
        count = f"{least}" if least == most else f"{least} to {most}"
        raise place.fault(f"has {len(value)} entries; it must have {count}")
    return value


def _frozen(value: Any) -> Any:
    """Nested lists as nested tuples."""
    return tuple(map(_frozen, value)) if isinstance(value, list) else value
