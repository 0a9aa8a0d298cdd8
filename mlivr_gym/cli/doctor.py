"""The command `mlivr-gym doctor`: a check of the installation on this machine.

Nothing that may be broken, such as Numba, is imported before it was found to work.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path
from typing import Any

from mlivr_gym import __version__
from mlivr_gym.cli.exits import FAILED, SUCCESS
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

BACKENDS = ("egl", "glfw", "osmesa")
"""Values of `MUJOCO_GL`: rendering without a screen, with one, and in software."""

PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco/>")
with mujoco.Renderer(model, 16, 16) as renderer:
    renderer.update_scene(mujoco.MjData(model))
    renderer.render()
"""
"""Program that renders one picture; each backend needs a process, since MuJoCo loads only one."""


def run(args: argparse.Namespace) -> int:
    """Check the installation.

    Told are the versions of the package and its requirements, what is too old, too new or broken of
    them, extras that are installed, GL libraries that can render, and where machine code and step
    tables are stored. The exit code is 1 if something that every command needs cannot be used.
    """
    needed = requirements()
    core, extras = needed.pop("", {}), needed
    wrong, newer = faults(core), untested(core)
    args.result |= {
        "mlivr_gym": __version__,
        "folder": Path(__file__).parent.parent,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "core": core,
        "extras": extras,
        "faults": wrong,
        "untested": newer,
    }
    print(f"mlivr-gym {__version__} in {Path(__file__).parent.parent}")
    print(f"Python {platform.python_version()} on {platform.platform()}")
    print("required packages: " + _version_list(core))
    for name, text in (wrong | newer).items():
        print(f"  {name} {text}")
    for name, packages in extras.items():
        missing = [package for package, version in packages.items() if version is None]
        remedy = f"; pip install 'mlivr-gym[{name}]'" if missing else ""
        print(f"extra [{name}]: {_version_list(packages)}{remedy}")
    if wrong:
        print("GL libraries and machine code are looked at once all required packages work")
        return FAILED
    args.result |= {"gl": _gl_report(args.quiet), "compiler": (compiler := _cache_report())}
    for name, value in compiler.items():
        print(f"{name.replace('_', ' ')}: {value}")
    return SUCCESS if compiler["cache_can_be_written"] else FAILED


def _gl_report(quiet: bool) -> dict[str, str]:
    """Print and return which GL libraries can render."""
    from mlivr_gym.cli.progress import Progress  # with Numba, which may be broken

    with Progress("testing the GL libraries", quiet=quiet):
        faults_of = {name: gl_fault(name) for name in BACKENDS}
    for name, fault in faults_of.items():
        print(f"GL library {name}: {fault or 'works'}")
    if all(faults_of.values()):
        print("  no GL library works: matplotlib draws the pictures, and films cannot be made")
    return {name: fault or "works" for name, fault in faults_of.items()}


def gl_fault(backend: str) -> str:
    """Return why MuJoCo cannot render with a backend here, in one line; `""` if it can."""
    library = {} if backend == "glfw" else {"PYOPENGL_PLATFORM": backend}
    return failure(PROBE, MUJOCO_GL=backend, **library)


def _version_list(packages: dict[str, str | None]) -> str:
    return ", ".join(f"{name} {version or 'MISSING'}" for name, version in packages.items())


def _cache_report() -> dict[str, Any]:
    """Return the state of compiled code and of the cache folders."""
    import numba  # which may be broken

    from mlivr_gym.compiled.cache import CACHE_VARIABLE, cache_folder, kernel_root

    tables, code = cache_folder(), kernel_root()
    stored = list(tables.glob("table-*-unpacked.npz")) if tables is not None else []
    return {
        "compiled_code": "switched off by NUMBA_DISABLE_JIT"
        if vars(numba.config)["DISABLE_JIT"]
        else f"numba {numba.__version__}, {numba.get_num_threads()} threads",
        "machine_code_kept_in": str(code),
        "machine_code_kept": "yes"
        if any(code.glob("*/*/*.nbc"))
        else "not yet: the first plan, or `mlivr-gym warmup`, compiles",
        "step_tables_kept_in": str(tables)
        if tables is not None
        else f"nowhere: {CACHE_VARIABLE} is empty",
        "step_tables_kept": len(stored),
        "cache_can_be_written": _can_be_written(code),
    }


def _can_be_written(folder: Path) -> bool:
    """Return whether files can be written to a folder, which may not exist yet."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)


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
