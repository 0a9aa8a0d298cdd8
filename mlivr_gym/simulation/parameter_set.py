"""Parameters that are checked when they are made: limits, controllers, physics and disturbances."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar, Self

from mlivr_gym.errors import SettingError
from mlivr_gym.schema import FieldPath, Struct


class ParameterSet:
    """Base class of the parameter sets of the simulation."""

    label: ClassVar[str]
    """Name of the parameter set in messages."""
    presets: ClassVar[Mapping[str, Any]] = {}
    """Parameter sets that can be given by name."""

    def __post_init__(self) -> None:
        """Check every parameter."""
        self._schema().check(self, FieldPath(self.label, SettingError))

    @classmethod
    def of(cls, given: Self | dict[str, Any] | str | None) -> Self:
        """Return a parameter set from an instance, plain data, or a name; the defaults from None.

        Raises a `SettingError` if no parameter set has this name, or a field is unknown or invalid.
        """
        known = cls.presets or None
        found: Self = cls._schema().given(given, FieldPath(cls.label, SettingError), known)
        return found

    @classmethod
    @cache
    def _schema(cls) -> Struct[Any]:
        """Return the validators of the fields."""
        return Struct.of(cls)
