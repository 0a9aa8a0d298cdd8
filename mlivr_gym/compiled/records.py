"""Records: data of fixed size that compiled code takes as one argument.

A subclass of `Record` lists the fields, with units and frames; its `dtype` is made from them.
Arrays of that type are filled once from the public classes. Compiled code reads and writes a field
as an attribute, `base.position`; Python, where NumPy has fields as items, as `base["position"]`.
With compilation switched off both notations work.
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

_settings: Any = config  # its attributes are set when it is loaded

Item = TypeVar("Item")


class Rows(Generic[Item]):
    """Field that is an array of records."""

    if TYPE_CHECKING:

        def __getitem__(self, index: Any) -> Item:
            """Return the record at an index."""


Vector = Annotated[Array, (3,)]
"""Field of three numbers."""

Matrix = Annotated[Array, (3, 3)]
"""Field of a 3 by 3 matrix; a rotation has the axes of its frame as columns."""

Joints = Annotated[Array, (6,)]
"""Field with one number for each joint of a limb."""


class PlainRow(np.record):  # type: ignore[misc]
    """Record used where compilation is switched off, whose fields are attributes.

    NumPy's own records hide a field whose name is an attribute of their class, such as `base`.
    """

    def __getattribute__(self, name: str) -> Any:
        """Return a field, or else the attribute of NumPy's record."""
        fields = np.void.__getattribute__(self, "dtype").fields
        return self[name] if name in fields else np.void.__getattribute__(self, name)

    def __setattr__(self, name: str, value: Any) -> None:
        """Set a field."""
        self[name] = value


class Record:
    """Base class of records.

    A field is annotated as `float`, `int`, `bool` or another record; or, with its shape, as an
    array of numbers or as `Rows` of records. An array may be annotated with another type of number
    too, and an `int` with a smaller one.

    Examples
    --------
    >>> class Ball(Record):
    ...     centre: Vector
    ...     radius: float
    >>> ball = Ball.row()
    >>> ball["centre"][2] = 1.0
    >>> ball["centre"].tolist()
    [0.0, 0.0, 1.0]
    """

    dtype: ClassVar[np.dtype[Any]]
    """NumPy type of one record."""

    if TYPE_CHECKING:

        def __getitem__(self, name: str) -> Any:
            """Return a field."""

        def __setitem__(self, name: str, value: Any) -> None:
            """Set a field."""

    def __init_subclass__(cls) -> None:
        """Make the NumPy type from the annotated fields."""
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
            # No `PlainRow`: Python takes a microsecond to read a field of one as an attribute.
            cls.dtype = np.dtype(layout, align=True)

    @classmethod
    def rows(cls, *shape: int) -> Any:
        """Return an array of records of the given shape, filled with zeros."""
        return np.zeros(shape, cls.dtype)

    @classmethod
    def row(cls) -> Any:
        """Return one record of zeros, which compiled code can write to."""
        return cls.rows(1)[0]


def _alignment(kind: np.dtype[Any]) -> int:
    """Return the alignment of a field [bytes], which NumPy loses where records are nested."""
    inner = kind.base.fields
    if inner is None:
        return kind.base.alignment
    return max(_alignment(field[0]) for field in inner.values())


def _kind(hint: Any) -> Any:
    """Return the type of a field, with its shape if it has one."""
    if get_origin(hint) is not Annotated:
        return hint.dtype if issubclass(hint, Record) else hint
    kind, *given = get_args(hint)
    if kind is int:
        return given[0]
    if get_origin(kind) is Rows:
        return get_args(kind)[0].dtype, given[0]
    return (given[1] if len(given) > 1 else np.float64), given[0]
