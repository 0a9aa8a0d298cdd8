"""The command `mlivr-gym doctor`: a check of the installation on this machine."""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import numba

from mlivr_gym import __version__
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.progress import Progress
from mlivr_gym.compiled.cache import CACHE_VARIABLE, cache_folder, kernel_digest, kernel_root
from mlivr_gym.compiled.ready_made import FIRST_PLAN, why_compiled
from mlivr_gym.errors import one_line

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

PROBE_TIMEOUT = 60.0
"""Time limit of a backend [s]."""

REQUIREMENT = re.compile(r"^([\w.-]+)(?:\[[^]]*\])?\s*([^;]*?)\s*(?:;.*extra == ['\"](\w+)['\"])?$")
"""A requirement in the metadata: the package, its versions, and the extra that needs it."""


def run(args: argparse.Namespace) -> int:
    """Check the installation.

    Told are the versions of the package and its requirements, extras that are installed, GL
    libraries that can render, and where machine code and step tables are stored. The exit code is 1
    if something that every command needs is missing.
    """
    with Progress("testing the GL libraries", quiet=args.quiet):
        gl = {name: gl_fault(name) for name in BACKENDS}
    needed = requirements()
    core, extras = needed.pop("", {}), needed
    compiler = _cache_report()
    args.result |= {
        "mlivr_gym": __version__,
        "folder": Path(__file__).parent.parent,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "core": core,
        "extras": extras,
        "gl": {name: fault or "works" for name, fault in gl.items()},
        "compiler": compiler,
    }
    print(f"mlivr-gym {__version__} in {Path(__file__).parent.parent}")
    print(f"Python {platform.python_version()} on {platform.platform()}")
    print("required packages: " + _version_list(core))
    for name, packages in extras.items():
        missing = [package for package, version in packages.items() if version is None]
        remedy = f"; pip install 'mlivr-gym[{name}]'" if missing else ""
        print(f"extra [{name}]: {_version_list(packages)}{remedy}")
    for name, fault in gl.items():
        print(f"GL library {name}: {fault or 'works'}")
    if all(gl.values()):
        print("  no GL library works: matplotlib draws the pictures, and films cannot be made")
    for name, value in compiler.items():
        print(f"{name.replace('_', ' ')}: {value}")
    absent = [package for package, version in core.items() if version is None]
    return FAILED if absent or not compiler["cache_can_be_written"] else SUCCESS


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


def gl_fault(backend: str) -> str:
    """Return why MuJoCo cannot render with a backend here, in one line; `""` if it can."""
    environment = os.environ | {"MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
    if backend == "glfw":
        environment.pop("PYOPENGL_PLATFORM")
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROBE],
            env=environment,
            capture_output=True,
            text=True,
            timeout=PROBE_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no result within {PROBE_TIMEOUT:g} s"
    if done.returncode == 0:
        return ""
    lines = [line for line in done.stderr.splitlines() if re.match(r"\S*(Error|Exception)\b", line)]
    return one_line(lines[-1]) if lines else f"ended with exit code {done.returncode}"


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _version_list(packages: dict[str, str | None]) -> str:
    return ", ".join(f"{name} {version or 'MISSING'}" for name, version in packages.items())


def _cache_report() -> dict[str, Any]:
    """Return the state of compiled code and of the cache folders."""
    tables, code = cache_folder(), kernel_root()
    stored = list(tables.glob("table-*-unpacked.npz")) if tables is not None else []
    why = why_compiled(kernel_digest(FIRST_PLAN))
    return {
        "compiled_code": "switched off by NUMBA_DISABLE_JIT"
        if vars(numba.config)["DISABLE_JIT"]
        else f"numba {numba.__version__}, {numba.get_num_threads()} threads",
        "ready_made_machine_code": f"not used: {why}" if why else "used",
        "machine_code_kept_in": str(code),
        "machine_code_kept": "yes"
        if any(code.glob("*/*/*.nbc"))
        else "not yet: the first plan, or `mlivr-gym warmup`, compiles what is not ready-made",
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
