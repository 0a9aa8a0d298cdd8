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
    folder, python = Path(__file__).parent.parent, platform.python_version()
    extras = requirements()
    core = extras.pop("", {})
    with ThreadPoolExecutor() as pool:
        told = dict(zip(core, pool.map(fault, core, core.values()), strict=True))
    wrong = {name: text for name, text in told.items() if text}
    newer = untested({"Python": python, **core})
    args.result |= {
        "mlivr_gym": __version__, "folder": folder, "python": python,
        "platform": platform.platform(), "core": core, "extras": extras, "faults": wrong,
        "untested": newer,
    }  # fmt: skip
    print(f"mlivr-gym {__version__} in {folder}")
    print(f"Python {python} on {platform.platform()}")
    for name, packages in {"required packages": core, **extras}.items():
        title = name if packages is core else f"extra [{name}]"
        shown = ", ".join(f"{one} {version or 'MISSING'}" for one, version in packages.items())
        lacks = packages is not core and None in packages.values()
        print(f"{title}: {shown}" + (f"; pip install 'mlivr-gym[{name}]'" if lacks else ""))
    for name, text in (wrong | newer).items():
        print(f"  {name} {text}")
    if wrong:
        print("GL libraries and machine code are looked at once all required packages work")
        return FAILED
    gl = {name: gl_fault(name) or "works" for name in BACKENDS}
    for name, text in gl.items():
        print(f"GL library {name}: {text}")
    if "works" not in gl.values():
        print("  no GL library works: matplotlib draws the pictures, and films cannot be made")
    compiler = _compiler()
    for name, value in compiler.items():
        print(f"{name.replace('_', ' ')}: {value}")
    args.result |= {"gl": gl, "compiler": compiler}
    return SUCCESS if compiler["cache_can_be_written"] else FAILED


def gl_fault(backend: str) -> str:
    """Return why MuJoCo cannot render with a backend here, in one line; `""` if it can."""
    library = {} if backend == "glfw" else {"PYOPENGL_PLATFORM": backend}
    return failure(PROBE, MUJOCO_GL=backend, **library)


def _compiler() -> dict[str, Any]:
    """Return the state of compiled code, and the cache folders."""
    import numba  # which may be broken

    from mlivr_gym.compiled.cache import CACHE_VARIABLE, cache_folder, kernel_root

    code = there = kernel_root()
    while not there.exists() and there != there.parent:
        there = there.parent
    is_off = vars(numba.config)["DISABLE_JIT"]
    used = f"numba {numba.__version__}, {numba.get_num_threads()} threads"
    return {
        "compiled_code": "switched off by NUMBA_DISABLE_JIT" if is_off else used,
        "machine_code_kept_in": str(code),
        "step_tables_kept_in": str(cache_folder() or f"nowhere: {CACHE_VARIABLE} is empty"),
        "cache_can_be_written": there.is_dir() and os.access(there, os.W_OK | os.X_OK),
    }


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


def fault(name: str, version: str | None) -> str:
    """Return what is wrong with a required package and what mends it, in one line; `""` if nothing.

    It is missing, older than any that was tested, or cannot be imported, as MuJoCo is not after an
    upgrade from 3 to 4 in place.
    """
    oldest = TESTED.get(name, ("0",))[0]
    if version is None:
        return f"is missing: pip install '{name}>={oldest}'"
    if _parts(version) < _parts(oldest):
        return f"{version} is too old: pip install '{name}>={oldest}'"
    # What follows the first sentence is advice, which for MuJoCo fails.
    error = re.split(r"\.\s", failure(f"import {MODULES.get(name, name)}"))[0]
    remedy = f"pip install --force-reinstall {name}"
    return error and f"{version} is broken: {remedy} ({error})"


def untested(versions: dict[str, str | None]) -> dict[str, str]:
    """Return which packages, and Python, are newer than any that was tested."""
    newest = {name: latest for name, (_, latest) in TESTED.items()}
    return {
        name: f"{version} is newer than {newest[name]}, the newest that was tested"
        for name, version in versions.items()
        if version and name in newest and _parts(version)[:2] > _parts(newest[name])
    }


def failure(code: str, **variables: str) -> str:
    """Return why a program of Python fails in a process of its own, in one line; `""` if not.

    `variables` are further ones of its environment.
    """
    environment = os.environ | {"PYTHONIOENCODING": "utf-8"} | variables
    program = [sys.executable, "-c", code]
    try:
        done = subprocess.run(
            program, env=environment, capture_output=True, timeout=TIMEOUT, check=False
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
