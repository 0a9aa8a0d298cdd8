"""Checks that optional packages are installed, which only the extras of this package need."""

from __future__ import annotations

import importlib.util

from mlivr_gym.errors import SettingError


def describe_missing(*packages: str, extra: str) -> str:
    """Return one sentence about the first package of an extra that is missing, or empty text."""
    for name in packages:
        if importlib.util.find_spec(name) is None:
            return f"this needs the package {name!r}: pip install 'mlivr-gym[{extra}]'"
    return ""


def require(*packages: str, extra: str) -> None:
    """Check that the packages of an extra are installed.

    Raises a `SettingError` that names the first one that is missing, and how to install it.
    """
    if message := describe_missing(*packages, extra=extra):
        raise SettingError(message)
