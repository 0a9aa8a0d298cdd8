"""Records: what has a fixed size and is handed to compiled code as one argument.

A class lists the fields, with units and frames; `dtype` is made of it. Rows of that type are filled
once from the public classes. Compiled code reads and writes fields as attributes, `base.position`;
Python, for which NumPy has them as items, as `base["position"]`. Where compilation is switched off
both ways serve.
"""

from __future__ import annotations

from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numba import config

from mlivr_gym.arrays import Array

_settings: Any = config  # its attributes are set as it is loaded

Item = TypeVar("Item")


class Rows(Generic[Item]):
    """Several records of a type, by one index or more."""

    if TYPE_CHECKING:

        def __getitem__(self, index: Any) -> Item:
            """One of them."""


Vector = Annotated[Array, (3,)]
"""Three numbers."""

Matrix = Annotated[Array, (3, 3)]
"""Three rows of three numbers; of a rotation, axes in columns."""

Joints = Annotated[Array, (6,)]
"""A number for each joint of a limb."""


class PlainRow(np.record):  # type: ignore[misc]
    """A row where compilation is switched off: its fields are attributes, whatever their names.

    NumPy's own records hide a field that is called like an attribute of its scalars, as `base`.
    """

    def __getattribute__(self, name: str) -> Any:
        """A field, or what NumPy's rows have under that name."""
        fields = np.void.__getattribute__(self, "dtype").fields
        return self[name] if name in fields else np.void.__getattribute__(self, name)

    def __setattr__(self, name: str, value: Any) -> None:
        """Set a field."""
        self[name] = value


class Record:
    """Base of records.

    A field is a `float`, `int` or `bool`, another record, or annotated with its shape: an array of
    numbers, of another type if that is annotated too, or `Rows`. An `int` may be
    annotated with a smaller type.

    Example:
        >>> class Ball(Record):
        ...     centre: Vector
        ...     radius: float
        >>> ball = Ball.row()
        >>> ball["centre"][2] = 1.0
        >>> ball["centre"].tolist()
        [0.0, 0.0, 1.0]
    """

    dtype: ClassVar[np.dtype[Any]]
    """Type of a row."""

    if TYPE_CHECKING:

        def __getitem__(self, name: str) -> Any:
            """A field."""

        def __setitem__(self, name: str, value: Any) -> None:
            """Set a field."""

    def __init_subclass__(cls) -> None:
        """Make the type of the fields."""
        hints = get_type_hints(cls, include_extras=True)
        fields = {name: np.dtype(_kind(hint)) for name, hint in hints.items() if name != "dtype"}
        offsets, size, widest = [], 0, 1
        for kind in fields.values():
            alignment = _alignment(kind)
            offsets.append(-(-size // alignment) * alignment)
            size, widest = offsets[-1] + kind.itemsize, max(widest, alignment)
        layout: Any = {"names": list(fields), "formats": list(fields.values()), "offsets": offsets}
        layout["itemsize"] = -(-size // widest) * widest
        if _settings.DISABLE_JIT:
            cls.dtype = np.dtype((PlainRow, np.dtype(layout)))
        else:
            # Attributes of rows that Python reads take a microsecond each.
            cls.dtype = np.dtype(layout, align=True)

    @classmethod
    def rows(cls, *shape: int) -> Any:
        """Rows of zeros."""
        return np.zeros(shape, cls.dtype)

    @classmethod
    def row(cls) -> Any:
        """One row of zeros, which compiled code can write to."""
        return cls.rows(1)[0]


def _alignment(kind: np.dtype[Any]) -> int:
    """What the place of a field must be divisible by; NumPy forgets it where records nest."""
    inner = kind.base.fields
    if inner is None:
        return kind.base.alignment
    return max(_alignment(field[0]) for field in inner.values())


def _kind(hint: Any) -> Any:
    """Type and shape of a field."""
    if get_origin(hint) is not Annotated:
        return hint.dtype if issubclass(hint, Record) else hint
    kind, *given = get_args(hint)
    if kind is int:
        return given[0]
    if get_origin(kind) is Rows:
        return get_args(kind)[0].dtype, given[0]
    return (given[1] if len(given) > 1 else np.float64), given[0]
