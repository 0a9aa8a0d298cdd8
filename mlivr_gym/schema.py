"""Schemas of data from files and callers: which fields they have, and how each one is checked.

Everything that is read from a file or given as plain data goes through a schema: maps, robots,
boxes, plans, settings and hyperparameters. A schema is a `Validator`; those of objects and lists
are composed of others. `read` either returns the converted data or raises one error, which names
the place (`points[3].normal[0]`), the value found there and what would be valid.
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass
from functools import cached_property
from typing import (
    Annotated,
    Any,
    Generic,
    NamedTuple,
    Protocol,
    TypeGuard,
    TypeVar,
    get_origin,
    get_type_hints,
)

import numpy as np

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.errors import MlivrError, shortened
from mlivr_gym.values import MAX_PARTS, MAX_TEXT_LENGTH

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)

ROTATION_TOLERANCE = 1e-5
"""Largest deviation of a rotation matrix times its transpose from the identity, in any entry."""


class FieldPath(NamedTuple):
    """Place of a value in the data, such as `points[3].normal`, and the type of errors about it."""

    path: str
    error: type[MlivrError]
    metres: float = 1.0
    """Unit of the lengths in the data [m], by which they are multiplied as they are read."""

    def field(self, name: str) -> FieldPath:
        """Return the path of a field of the object at this place."""
        is_start = not self.path or self.path.endswith(" ")
        return self._replace(path=f"{self.path}{'' if is_start else '.'}{name}")

    def entry(self, number: int) -> FieldPath:
        """Return the path of an entry of the list at this place."""
        return self._replace(path=f"{self.path}[{number}]")

    def fault(self, message: str) -> MlivrError:
        """Return an error whose message is this place followed by `message`."""
        return self.error(f"{self.path or 'the data'} {message}")

    def refused(self, value: object, kind: str) -> MlivrError:
        """Return an error that shows the value and says what it must be."""
        return self.fault(f"is {shortened(value)}; it must be {kind}")

    def build(self, make: Callable[..., T], *args: Any, **options: Any) -> T:
        """Call a constructor with checked values; its errors get this place and type."""
        try:
            return make(*args, **options)
        except MlivrError as fault:
            raise self.error(f"{self.path}: {fault}" if self.path else str(fault)) from None


class Validator(Protocol[T_co]):
    """Check of a value, which converts it or raises an error."""

    def read(self, value: object, place: FieldPath) -> T_co:
        """Return the converted value; raise an error of the type of `place` if it is not valid."""


class Anything:
    """Any value, for example a remark in a file, which the program does not use."""

    def read(self, value: object, place: FieldPath) -> object:
        """Return the value unchanged."""
        return value


@dataclass(frozen=True)
class Text:
    """Printable text."""

    least: int = 1
    """Minimum number of characters."""
    most: int = MAX_TEXT_LENGTH
    """Maximum number of characters."""

    def read(self, value: object, place: FieldPath) -> str:
        """Return the text; a lone surrogate, for example, is refused: no file could hold it."""
        if (
            not isinstance(value, str)
            or not self.least <= len(value) <= self.most
            or not value.isprintable()
        ):
            kind = f"a text of {self.least} to {self.most} printable characters"
            raise place.refused(value, kind)
        return value


class Flag:
    """Either True or False; numbers are refused."""

    def read(self, value: object, place: FieldPath) -> bool:
        """Return the truth value as a bool."""
        if not isinstance(value, (bool, np.bool_)):
            raise place.refused(value, "true or false")
        return bool(value)


@dataclass(frozen=True)
class Choice:
    """One of several names."""

    options: tuple[str, ...]

    def read(self, value: object, place: FieldPath) -> str:
        """Return the name; the error of another one suggests the most similar valid name."""
        if not isinstance(value, str) or value not in self.options:
            message = (
                f"is {shortened(value)}; valid choices are {', '.join(map(repr, self.options))}"
            )
            raise place.fault(message + suggest(value, self.options))
        return str(value)


@dataclass(frozen=True)
class Integer:
    """An integer from `least` to `most`; a bool or a float is refused."""

    least: int
    most: int

    def read(self, value: object, place: FieldPath) -> int:
        """Return the integer as an int."""
        if (
            isinstance(value, bool)
            or not isinstance(value, (int, np.integer))
            or not self.least <= value <= self.most
        ):
            raise place.refused(value, f"a whole number from {self.least} to {self.most}")
        return int(value)


@dataclass(frozen=True)
class Numbers:
    """Finite numbers in an array or in nested lists of a given shape."""

    shape: tuple[int | None, ...] = ()
    """The shape; None as its first entry leaves the number of rows open."""
    least: float = -np.inf
    """Minimum of each number."""
    most: float = np.inf
    """Maximum of each number."""
    unit: str = ""
    """The unit. Of lengths [m] above `most` the message ends with `hint`."""
    rows: tuple[int, int] = (1, MAX_PARTS)
    """Minimum and maximum number of rows where the shape leaves it open."""
    hint: str = "lengths are in metres: is this in millimetres?"
    """End of the message about a length that is too large."""

    def read(self, value: object, place: FieldPath) -> Array:
        """Return the numbers as an array of floats."""
        count = len(_list(value, place, *self.rows)) if None in self.shape else 0
        shape = tuple(count if size is None else size for size in self.shape)
        if 0 in shape:
            return np.zeros(shape)
        try:
            array = np.array(value)
            # Integers of more than 64 bits give an array of objects.
            found = array.astype(np.float64) if array.dtype.kind in "iufO" else None
        except (TypeError, ValueError, OverflowError):
            found = None  # rows of different lengths, not numbers, larger than every float
        if found is None or found.shape != shape or _holds_flag(value):
            there = () if found is None else found.shape
            shape_found = "is " if there in ((), shape) else f"has shape {there}, "
            kind = "a finite number" if shape == () else f"finite numbers of shape {shape}"
            raise place.fault(f"{shape_found}{shortened(value)}; it must be {kind}")
        if self.unit == "m":
            found = found * place.metres
        wrong = ~np.isfinite(found) | (found < self.least) | (found > self.most)
        if self.unit == "m":
            wrong |= np.abs(found) > self.most
        if wrong.any():
            first = np.unravel_index(int(wrong.argmax()), shape)
            for index in first:
                place = place.entry(int(index))
            if not np.isfinite(found[first]):
                raise place.refused(array.item(first), "a finite number")
            is_metres = self.unit != "m" or place.metres == 1.0
            note = "" if is_metres else f"; in its unit it is {array.item(first):g}"
            if self.unit == "m" and abs(found[first]) > self.most:
                told = note or f"; {self.hint}"
                raise place.fault(f"is {found[first]:g}, larger than {self.most:g} m{told}")
            raise place.refused(float(found[first]), f"{self._range()}{note}")
        return found

    def _range(self) -> str:
        """Return the valid range in words."""
        unit = f" {self.unit}" if self.unit else ""
        if self.most == np.inf:
            return f"at least {self.least:g}{unit}"
        return f"from {self.least:g} to {self.most:g}{unit}"


@dataclass(frozen=True)
class Tuples(Numbers):
    """Finite numbers as nested tuples, or a single number as a float."""

    def read(self, value: object, place: FieldPath) -> Any:
        """Return the numbers as nested tuples, or as a float if the shape is ()."""
        return _frozen(super().read(value, place).tolist())


class Rotation:
    """A right-handed rotation matrix, given by its rows."""

    def read(self, value: object, place: FieldPath) -> Any:
        """Return the matrix as three tuples of three numbers."""
        found = Numbers((3, 3)).read(value, place)
        if not are_rotations(found).all():
            raise place.fault("must be a right-handed rotation matrix")
        return _frozen(found.tolist())


def are_rotations(turns: Array) -> BoolArray:
    """Return which of some matrices of shape (..., 3, 3) are right-handed rotations."""
    turned = np.clip(turns, -2.0, 2.0)  # squares of huge numbers would overflow
    error = np.abs(np.swapaxes(turned, -1, -2) @ turned - np.eye(3)).max(axis=(-2, -1))
    right: BoolArray = (error <= ROTATION_TOLERANCE) & (np.linalg.det(turned) > 0.0)
    return right


@dataclass(frozen=True)
class OrNone(Generic[T]):
    """Either None or a value of another kind."""

    kind: Validator[T]

    def read(self, value: object, place: FieldPath) -> T | None:
        """Return None, or the value as the other kind reads it."""
        return None if value is None else self.kind.read(value, place)


@dataclass(frozen=True)
class ListOf(Generic[T]):
    """A list whose entries are of another kind, with `least` to `most` entries."""

    kind: Validator[T]
    least: int = 0
    most: int = MAX_PARTS

    def read(self, value: object, place: FieldPath) -> tuple[T, ...]:
        """Return the entries as the other kind reads them."""
        listed = _list(value, place, self.least, self.most)
        return tuple(self.kind.read(entry, place.entry(k)) for k, entry in enumerate(listed))


@dataclass(frozen=True)
class Fields:
    """An object with named fields."""

    required: Mapping[str, Validator[Any]]
    """Validator of each field that must be given."""
    optional: Mapping[str, Validator[Any]] = dataclasses.field(default_factory=dict)
    """Validator of each field that may be given."""
    others: bool = False
    """Whether further fields are allowed, of any kind."""

    @cached_property
    def _kinds(self) -> dict[str, Validator[Any]]:
        """Validator of each field by name."""
        return {**self.required, **self.optional}

    def read(self, value: object, place: FieldPath) -> dict[str, Any]:
        """Return the fields that are given, each as its kind reads it."""
        known = ", ".join(self._kinds)
        if not isinstance(value, dict):
            raise place.refused(value, f"an object with {known}")
        for name in value:
            if name not in self._kinds and not self.others:
                hint = suggest(name, self._kinds)
                message = f"has an unknown field {shortened(name)}; valid fields are {known}{hint}"
                raise place.fault(message)
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
    """An object with the fields of a dataclass."""

    made: type[T]
    """The dataclass."""
    validators: Mapping[str, Validator[Any]]
    """Validator of each field."""
    complete: bool = False
    """Whether fields that have a default value must be given too."""

    @classmethod
    def of(cls, made: type[T], *, complete: bool = False) -> Struct[T]:
        """Return the schema of a dataclass whose fields are `Annotated` with their validators."""
        kinds = get_type_hints(made, include_extras=True)
        annotated = {name: kind for name, kind in kinds.items() if get_origin(kind) is Annotated}
        return cls(made, {name: kind.__metadata__[0] for name, kind in annotated.items()}, complete)

    @cached_property
    def fields(self) -> Fields:
        """Validators of the fields in plain data."""
        missing: dict[str, Validator[Any]] = {}
        optional: dict[str, Validator[Any]] = {}
        for entry in dataclasses.fields(self.made):  # type: ignore[arg-type]
            needed = entry.default is MISSING and entry.default_factory is MISSING
            if entry.name in self.validators:
                part = missing if needed or self.complete else optional
                part[entry.name] = self.validators[entry.name]
        return Fields(missing, optional)

    def read(self, value: object, place: FieldPath) -> T:
        """Return an instance of the dataclass from plain data, or the instance that is given."""
        if isinstance(value, self.made):
            return value
        return place.build(self.made, **self.fields.read(value, place))

    def given(self, value: object, place: FieldPath, known: Mapping[str, T] | None = None) -> T:
        """Return a record that is given as itself, as plain data, by a name of `known`, or by None.

        None stands for the record with all its default values.
        """
        if isinstance(value, str) and known is not None:
            return known[Choice(tuple(known)).read(value, place)]
        return self.read({} if value is None else value, place)

    def check(self, record: T, place: FieldPath) -> None:
        """Check and convert the fields of a frozen record; its `__post_init__` calls this.

        Raises an error of the type of `place`, which names the field.
        """
        for name, kind in self.validators.items():
            found = kind.read(getattr(record, name), place.field(name))
            object.__setattr__(record, name, found)


NAME = Text()
"""Validator of a name: printable text that is not empty."""


def suggest(value: object, valid: Iterable[str]) -> str:
    """Return the end of a message that suggests the valid name most similar to an invalid one."""
    nearest = (
        difflib.get_close_matches(value[:MAX_TEXT_LENGTH], valid, 1)
        if isinstance(value, str)
        else []
    )
    return f"; did you mean {nearest[0]!r}?" if nearest else ""


def is_list(value: object) -> TypeGuard[Sequence[Any]]:
    """Return whether a value is a list, a tuple or an array with axes."""
    return isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def _list(value: object, place: FieldPath, least: int, most: int) -> Any:
    """Return a list, a tuple or an array with axes, if its length is valid."""
    if not is_list(value):
        raise place.refused(value, "a list")
    if not least <= len(value) <= most:
        count = f"{least}" if least == most else f"{least} to {most}"
        raise place.fault(f"has {len(value)} entries; it must have {count}")
    return value


def _holds_flag(value: object) -> bool:
    """Return whether True or False is among nested lists of numbers, which NumPy takes for 1 or 0.

    An array of them has a kind of its own.
    """
    if isinstance(value, (list, tuple)):
        return any(map(_holds_flag, value))
    return isinstance(value, (bool, np.bool_))


def _frozen(value: Any) -> Any:
    """Return nested lists as nested tuples."""
    return tuple(map(_frozen, value)) if isinstance(value, list) else value
