"""The command `mlivr-gym doctor`: a check of the installation on this machine."""

from __future__ import annotations

import argparse
import os
import platform
from pathlib import Path
from typing import Any

from mlivr_gym import __version__
from mlivr_gym.cli.exits import FAILED, SUCCESS
from mlivr_gym.cli.installed import failure, faults, requirements, untested

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
