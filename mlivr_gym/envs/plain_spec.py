"""Arguments of the environments as plain data, so that Gymnasium can write them as JSON.

`gymnasium.make` stores the arguments in `env.spec`, and `env.spec.to_json()` accepts only types of
JSON. Maps, robots, `Physics` and arrays are therefore stored as dictionaries and lists, which the
environments accept in their place.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec


def plain_value(value: Any) -> Any:
    """Return a value as plain data of JSON; a value that has no such form is returned unchanged."""
    if hasattr(value, "to_dict"):
        return plain_value(value.to_dict())
    ours = type(value).__module__.startswith("mlivr_gym.")
    if is_dataclass(value) and not isinstance(value, type) and ours:
        return plain_value(asdict(value))
    if isinstance(value, Mapping):
        return {name: plain_value(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_value(entry) for entry in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Enum):
        return value.value
    return str(value) if isinstance(value, Path) else value


class PlainSpec:
    """Mix-in whose property `spec` has the arguments of the environment as plain data."""

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """Spec from which `gymnasium.make` made the environment, otherwise None."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec = copy.copy(spec)
            spec.kwargs = plain_value(spec.kwargs)
        self._spec = spec
