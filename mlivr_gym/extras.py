"""Packages of the extras, which the core of the package does without."""

from __future__ import annotations

import importlib.util

from mlivr_gym.errors import SettingError


def missing(*packages: str, extra: str) -> str:
    """What to install of an extra of this package, one sentence; empty if all of it is there."""
    for name in packages:
        if importlib.util.find_spec(name) is None:
            return f"this needs the package {name!r}: pip install 'mlivr-gym[{extra}]'"
    return ""


def need(*packages: str, extra: str) -> None:
    """Refuse where packages of an extra are not installed.

    Raises
    ------
    SettingError
        naming the first of them.
    """
    if told := missing(*packages, extra=extra):
        raise SettingError(told)
