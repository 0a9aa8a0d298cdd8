"""Figures that are checked when they are made: limits, controllers, physics, disturbances."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

from mlivr_gym.errors import SettingError
from mlivr_gym.schema import FieldPath, Kind, Struct


class Figures:
    """What the dataclasses of this folder that hold figures share."""

    called: ClassVar[str]
    """What they are called in messages."""
    kinds: ClassVar[Mapping[str, Kind[Any]]]
    """Kind of each field."""
    named: ClassVar[Mapping[str, Any]] = {}
    """Those that have names."""

    def __post_init__(self) -> None:
        """Check every figure."""
        Struct(type(self), self.kinds).check(self, FieldPath(self.called, SettingError))

    @classmethod
    def of(cls, given: Self | dict[str, Any] | str | None) -> Self:
        """The figures as they are, from plain data, by name (one of `named`), or by default.

        Raises
        ------
        SettingError
            If there is no such name or field, or a field has a faulty value.
        """
        known = cls.named or None
        return Struct(cls, cls.kinds).given(given, FieldPath(cls.called, SettingError), known)
