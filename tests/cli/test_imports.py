"""What commands import: names, not times, which are the same on every machine."""

import shlex
import subprocess
import sys

import pytest

from mlivr_gym.cli.main import every_command

TOLD = """
import sys
from mlivr_gym.cli.main import main
try:
    main({words})
except SystemExit as ended:
    assert not ended.code
print(*sys.modules)
"""

COMPILING = {"numba", "llvmlite", "scipy"}
"""What only computing needs: half a second of imports."""

HEAVY = {"mujoco", "matplotlib", "PIL", "torch", "scipy.spatial", "scipy.interpolate"}
"""What a plan does not need; SciPy's parts alone take 0.3 s to import."""

PARTS = {f"mlivr_gym.{part}" for part in ("agents", "simulation")}
"""Folders of the package that a plan does not need."""


def imported(line):
    """Modules that a command line imports."""
    code = TOLD.format(words=shlex.split(line))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("line", ["--help", "--version"])
def test_what_needs_no_kernel_imports_no_compiler(line):
    found = imported(line)
    assert not (COMPILING | HEAVY) & found
    assert not {place for place, _ in every_command().values()} & found
    assert "gymnasium.envs.registration" in found  # as `import mlivr_gym` promises


def test_a_plan_imports_what_it_needs_alone():
    found = imported("plan --start D2a:4 D2b:4 --goal 6.0 0 0.42 --cost steps")
    assert "numba" in found
    assert not (HEAVY | PARTS) & found
    assert {name for name, (place, _) in every_command().items() if place in found} == {"plan"}
    drawing = {module for module in found if module.startswith("mlivr_gym.pictures.")}
    assert drawing == {"mlivr_gym.pictures.figures"}  # names of files to be written


def test_an_environment_imports_no_torch():
    code = "import sys, gymnasium, mlivr_gym; gymnasium.make('MLIVR-JEM-v0').reset(seed=0)"
    code += "; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
