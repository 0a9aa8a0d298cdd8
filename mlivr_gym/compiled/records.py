"""Records: data of fixed size that compiled code takes as one argument.

A subclass of `Record` lists the fields, with units and frames; its `dtype` is made from them.
Arrays of that type are filled once from the public classes. Compiled code reads and writes a field
as an attribute, `base.position`; Python, where NumPy has fields as items, as `base["position"]`.
With compilation switched off both notations work.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from operator import itemgetter
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


@cache
def readable(kind: np.dtype[Any]) -> np.dtype[Any]:
    """Return a type of the same layout, whose records have their fields as attributes, too.

    That is how kernels read them; Python's own code, for which it is slower, does not need it.
    Other types are returned as they are. NumPy's `recarray` hides fields that are called like
    attributes of its classes, such as `base`.
    """
    if kind.subdtype is not None:
        inner, shape = kind.subdtype
        return np.dtype((readable(inner), shape))
    if kind.names is None:
        return kind
    fields = [kind.fields[name] for name in kind.names]  # type: ignore[index]
    layout: Any = {
        "names": kind.names,
        "formats": [readable(field[0]) for field in fields],
        "offsets": [field[1] for field in fields],
        "itemsize": kind.itemsize,
    }
    attributes = {name: property(itemgetter(name), _setter(name)) for name in kind.names}
    return np.dtype((type("Row", (np.void,), attributes), np.dtype(layout)))


def _setter(name: str) -> Callable[[Any, Any], None]:
    """Return a function that sets a field of a record."""

    def set_field(row: Any, value: Any) -> None:
        row[name] = value

    return set_field


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
        aligned = np.dtype(layout, align=True)
        cls.dtype = readable(aligned) if _settings.DISABLE_JIT else aligned

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
