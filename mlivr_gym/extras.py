"""Checks that optional packages are installed, which only the extras of this package need."""

from __future__ import annotations

import importlib.util

from mlivr_gym.errors import SettingError


def describe_missing(*packages: str, extra: str) -> str:
    """Return one sentence about the first package that is missing, or empty text if none is.

    Parameters
    ----------
    *packages
        Names of the packages.
    extra
        Extra of `mlivr-gym` that installs them.
    """
    for name in packages:
        if importlib.util.find_spec(name) is None:
            return f"this needs the package {name!r}: pip install 'mlivr-gym[{extra}]'"
    return ""


def require(*packages: str, extra: str) -> None:
    """Check that the packages of an extra are installed.

    Parameters
    ----------
    *packages
        Names of the packages.
    extra
        Extra of `mlivr-gym` that installs them.

    Raises
    ------
    SettingError
        If a package is missing; the message names the first one and how to install it.
    """
    if message := describe_missing(*packages, extra=extra):
        raise SettingError(message)
