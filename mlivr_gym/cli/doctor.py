"""The command `mlivr-gym doctor`: what there is on this machine, and what is missing."""

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
from mlivr_gym.cli.arguments import Add, command
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.progress import Progress
from mlivr_gym.compiled.cache import CACHE_VARIABLE, cache_folder, kernel_root
from mlivr_gym.compiled.ready_made import why_compiled
from mlivr_gym.errors import one_line
from mlivr_gym.stances.build import COMPILED

BACKENDS = ("egl", "glfw", "osmesa")
"""Values of `MUJOCO_GL`: without a screen, with one, and in software."""

PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco/>")
with mujoco.Renderer(model, 16, 16) as renderer:
    renderer.update_scene(mujoco.MjData(model))
    renderer.render()
"""
"""Renders one picture, in a process of its own, since MuJoCo takes one backend a process."""

PROBE_TIMEOUT = 60.0
"""How long a backend may take [s]."""

REQUIREMENT = re.compile(r"^([\w.-]+)(?:\[[^]]*\])?\s*([^;]*?)\s*(?:;.*extra == ['\"](\w+)['\"])?$")
"""A requirement in the metadata: the package, its versions, and the extra that asks for it."""


def add_command(add: Add) -> None:
    """Add the command by `add_parser`, which is told its name and help."""
    command(
        add,
        run,
        description="Tell the versions of the package and of what it needs, which extras are "
        "installed, which GL libraries render, and where machine code and step tables are kept. "
        "Exit code 1 if something that every command needs is missing.",
    )


def run(args: argparse.Namespace) -> int:
    """Look at everything, and tell it."""
    with Progress("trying the GL libraries", quiet=args.quiet):
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
    print("needed: " + _version_list(core))
    for name, packages in extras.items():
        missing = [package for package, version in packages.items() if version is None]
        how = f"; pip install 'mlivr-gym[{name}]'" if missing else ""
        print(f"extra [{name}]: {_version_list(packages)}{how}")
    for name, fault in gl.items():
        print(f"GL by {name}: {fault or 'works'}")
    if all(gl.values()):
        print("  no GL library works: pictures are drawn with matplotlib, and there are no films")
    for name, value in compiler.items():
        print(f"{name.replace('_', ' ')}: {value}")
    absent = [package for package, version in core.items() if version is None]
    return FAILED if absent or not compiler["cache_can_be_written"] else SUCCESS


def requirements() -> dict[str, dict[str, str | None]]:
    """Installed version, or None, of each package that is needed, by extra; `""` is the core."""
    found: dict[str, dict[str, str | None]] = {"": {}}
    try:
        listed = metadata.requires("mlivr-gym") or []
    except metadata.PackageNotFoundError:  # run from a checkout that is not installed
        return found
    for line in listed:
        match = REQUIREMENT.match(line)
        if match is not None:
            package, _, extra = match.groups()
            found.setdefault(extra or "", {})[package] = _version(package)
    return found


def gl_fault(backend: str) -> str:
    """Why MuJoCo cannot render with a backend here, in one line; empty if it can."""
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
        return f"no answer within {PROBE_TIMEOUT:g} s"
    if done.returncode == 0:
        return ""
    lines = [line for line in done.stderr.splitlines() if re.match(r"\S*(Error|Exception)\b", line)]
    return one_line(lines[-1]) if lines else f"ended with {done.returncode}"


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _version_list(packages: dict[str, str | None]) -> str:
    return ", ".join(f"{name} {version or 'MISSING'}" for name, version in packages.items())


def _cache_report() -> dict[str, Any]:
    """What is known of compiled code and of the folders where answers are kept."""
    tables, code = cache_folder(), kernel_root()
    kept = list(tables.glob("pairs-*.npz")) if tables is not None else []
    why = why_compiled(COMPILED.parent.name)
    return {
        "compiled_code": "switched off by NUMBA_DISABLE_JIT"
        if vars(numba.config)["DISABLE_JIT"]
        else f"numba {numba.__version__}, {numba.get_num_threads()} threads",
        "ready_made_machine_code": f"not used: {why}" if why else "used",
        "machine_code_kept_in": str(code),
        "machine_code_kept": "yes"
        if any(code.glob("*/compiled"))
        else "not yet: what is not ready-made is compiled by the first plan, or `mlivr-gym warmup`",
        "step_tables_kept_in": str(tables) if tables is not None else f"nowhere: {CACHE_VARIABLE}",
        "step_tables_kept": len(kept),
        "cache_can_be_written": _can_be_written(code),
    }


def _can_be_written(folder: Path) -> bool:
    """Whether files can be written to a folder, which may have to be made first."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)
