"""Arguments of the environments as plain data, which Gymnasium can write as JSON.

`gymnasium.make` keeps the arguments it was given in `env.spec`, and `env.spec.to_json()` takes only
what JSON knows. Maps, robots, `Physics` and arrays are therefore kept as dictionaries and lists,
which the environments take in their place.
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
    """A value as what JSON knows, as far as that goes: anything of another kind stays as it is."""
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


def plain_spec(spec: EnvSpec | None) -> EnvSpec | None:
    """A copy of a spec whose arguments are plain data."""
    if spec is not None:
        spec = copy.copy(spec)
        spec.kwargs = plain_value(spec.kwargs)
    return spec


class PlainSpec:
    """The property `spec` of an environment, with its arguments as plain data."""

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """What made the environment; None without `gymnasium.make`."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = plain_spec(spec)
