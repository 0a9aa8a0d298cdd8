"""Checks that optional packages are installed, which only the extras of this package need."""

from __future__ import annotations

import importlib.util

from mlivr_gym.errors import SettingError


def require(*packages: str, extra: str) -> None:
    """Check that the packages of an extra are installed.

    Raises a `SettingError` that names the first one that is missing, and how to install it.
    """
    for name in packages:
        if importlib.util.find_spec(name) is None:
            raise SettingError(f"this needs the package {name!r}: pip install 'mlivr-gym[{extra}]'")
