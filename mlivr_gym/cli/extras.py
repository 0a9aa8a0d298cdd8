"""What the commands of agents need besides the core of the package."""

from __future__ import annotations

import importlib.util

from mlivr_gym.errors import SettingError


def need(*modules: str, extra: str) -> None:
    """Refuse in one sentence where an extra is not installed."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            raise SettingError(
                f"this needs the package {module!r}: pip install 'mlivr-gym[{extra}]'"
            )
