"""What is installed of Python and of the required packages, and what is wrong with it."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata

from mlivr_gym.errors import one_line

TESTED = {
    "Python": ("3.11", "3.13"),
    "gymnasium": ("1.2", "1.4"),
    "matplotlib": ("3.9", "3.11"),
    "mujoco": ("3.17", "4.0"),
    "numba": ("0.61", "0.68"),
    "numpy": ("2.0", "2.5"),
    "pillow": ("11.0", "13.0"),
    "platformdirs": ("4.2", "4.14"),
    "scipy": ("1.14", "1.18"),
}
"""Oldest and newest version with which the tests were run, of Python and each required package."""

MODULES = {"pillow": "PIL"}
"""Names under which packages are imported, where they differ."""

TIMEOUT = 60.0
"""Time limit of a program that tries something [s]."""

REQUIREMENT = re.compile(r"^([\w.-]+)(?:\[[^]]*\])?\s*([^;]*?)\s*(?:;.*extra == ['\"](\w+)['\"])?$")
"""A requirement in the metadata: the package, its versions, and the extra that needs it."""


def requirements() -> dict[str, dict[str, str | None]]:
    """Return the installed version, or None, of each requirement, by extra; `""` is the core."""
    versions: dict[str, dict[str, str | None]] = {"": {}}
    try:
        listed = metadata.requires("mlivr-gym") or []
    except metadata.PackageNotFoundError:  # run from a checkout that is not installed
        return versions
    for line in listed:
        match = REQUIREMENT.match(line)
        if match is not None:
            package, _, extra = match.groups()
            versions.setdefault(extra or "", {})[package] = _version(package)
    return versions


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def faults(core: dict[str, str | None]) -> dict[str, str]:
    """Return what is wrong with required packages and what mends it, one line each, by name.

    One is missing, older than any that was tested, or cannot be imported, as MuJoCo is not after
    an upgrade from 3 to 4 in place.
    """
    faulty = {}
    for name, version in core.items():
        oldest = TESTED.get(name, ("0",))[0]
        if version is None:
            faulty[name] = f"is missing: pip install '{name}>={oldest}'"
        elif _parts(version) < _parts(oldest):
            faulty[name] = f"{version} is too old: pip install '{name}>={oldest}'"
    rest = [name for name in core if name not in faulty]
    with ThreadPoolExecutor() as pool:
        errors = pool.map(lambda name: failure(f"import {MODULES.get(name, name)}"), rest)
    for name, error in zip(rest, errors, strict=True):
        if error:
            told = re.split(r"\.\s", error)[0]  # what follows is advice, which for MuJoCo fails
            faulty[name] = f"{core[name]} is broken: pip install --force-reinstall {name} ({told})"
    return faulty


def untested(core: dict[str, str | None]) -> dict[str, str]:
    """Return which of Python and the required packages are newer than any that was tested."""
    found = {}
    for name, version in {"Python": platform.python_version(), **core}.items():
        newest = TESTED[name][1] if name in TESTED else ""
        if version is not None and newest and _parts(version)[:2] > _parts(newest):
            found[name] = f"{version} is newer than {newest}, the newest that was tested"
    return found


def failure(code: str, **variables: str) -> str:
    """Return why a program of Python fails in a process of its own, in one line; `""` if not.

    `variables` are further ones of its environment.
    """
    environment = os.environ | {"PYTHONIOENCODING": "utf-8"} | variables
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            capture_output=True,
            timeout=TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no result within {TIMEOUT:g} s"
    if done.returncode == 0:
        return ""
    lines = done.stderr.decode(errors="replace").splitlines()
    told = [line for line in lines if re.match(r"\S*(Error|Exception)\b", line)]
    return one_line(told[-1]) if told else f"ended with exit code {done.returncode}"


def _parts(version: str) -> tuple[int, ...]:
    """Return the numbers of the release that a version names."""
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])
