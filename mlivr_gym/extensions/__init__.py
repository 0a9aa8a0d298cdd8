"""Extensions: folders with commands and environments of their own, each of which can be taken away.

An extension uses public names of the core alone; the core imports none. Its package may have

* `COMMANDS`: for each command the line of the help and some examples. The module of that name
  implements it, with `run` and `add_options` as the modules of `mlivr_gym.cli`.
* `ENVIRONMENTS`: for each id the other arguments of `gymnasium.register`.

Both are read whenever `mlivr_gym` is imported, so that a package imports nothing that takes time.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

__all__ = ["commands", "environments"]


def _packages() -> Iterator[ModuleType]:
    """Yield the extensions that are there."""
    return (import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__))


def commands() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return the module of each command, and its help line with examples."""
    return {
        name: (f"{package.__name__}.{name}", lines)
        for package in _packages()
        for name, lines in getattr(package, "COMMANDS", {}).items()
    }


def environments() -> dict[str, dict[str, Any]]:
    """Return the arguments of `gymnasium.register` for each id."""
    return {
        name: arguments
        for package in _packages()
        for name, arguments in getattr(package, "ENVIRONMENTS", {}).items()
    }
