"""What processes import and need: few packages, no call of POSIX, whatever a machine has."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from machine import MAY_BE_MISSING

from mlivr_gym.cli.main import every_command

ROOT = Path(__file__).parent.parent

WITHOUT = """
import sys
from importlib.machinery import PathFinder

class Others(PathFinder):
    @classmethod
    def find_spec(cls, name, *given):
        return None if name in {names} else super().find_spec(name, *given)

sys.meta_path[sys.meta_path.index(PathFinder)] = Others
"""
"""Hides packages."""

COLLECT = """
import pytest
sys.exit(pytest.main(["tests", "--collect-only", "-qrs", "-p", "no:cacheprovider"]))
"""

IMPORT = """
import importlib, pkgutil, mlivr_gym
for module in pkgutil.walk_packages(mlivr_gym.__path__, "mlivr_gym."):
    try:
        importlib.import_module(module.name)
    except ImportError:
        print(module.name)
"""

NEED_EXTRAS = ("mlivr_gym.agents.", "mlivr_gym.extensions.viewer.", "mlivr_gym.envs.dm_env")
"""What cannot be imported without an extra; all else says in words what is missing, when used."""


def test_whatever_does_not_need_an_extra_is_imported_without_any():
    code = WITHOUT.format(names=sorted(MAY_BE_MISSING)) + IMPORT
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout
    assert [name for name in done.stdout.split() if not name.startswith(NEED_EXTRAS)] == []


@pytest.mark.slow
def test_files_that_need_no_missing_package_are_collected():
    """With no package of any extra; the files that import one are skipped, with its name."""
    code = WITHOUT.format(names=sorted(MAY_BE_MISSING)) + COLLECT
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:]
    skipped = [line for line in done.stdout.splitlines() if line.startswith("SKIPPED")]
    told = "\n".join(skipped)
    assert "tests/agents/test_imitation.py: torch is not installed" in told
    assert "tests/envs/test_env.py: " in done.stdout
    assert len(skipped) < len(list((ROOT / "tests").glob("**/test_*.py"))) / 2


LOCALE = {"PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}

AS_ON_WINDOWS = """
import os, signal, sys
import gymnasium, matplotlib.pyplot, mujoco, numba, platformdirs, scipy.optimize, PIL.Image
import concurrent.futures, multiprocessing.resource_tracker, subprocess, tempfile
for name in ("fcntl", "grp", "pwd", "resource", "termios"):
    sys.modules[name] = None
for name in "chown fork getuid geteuid getgid killpg nice pread sched_getaffinity sysconf".split():
    delattr(os, name)
for name in "SIGALRM SIGHUP SIGKILL alarm pthread_kill pthread_sigmask setitimer sigwait".split():
    delattr(signal, name)
"""
"""What makes a process lack what Windows lacks; other packages are imported before."""

WALK = """
from mlivr_gym.cli.main import main
file = os.fsdecode("plän.json".encode())
plan = f"plan --start D2a:4 D2b:4 --goal 6.0 0 0.42 --cost steps --out {file} --picture plan.png"
for _ in range(2):  # the files are new, then replaced
    assert main(plan.split()) == 0
assert main(f"simulate --plan {file} --no-film --out walk".split()) == 0
"""


def test_a_walk_needs_no_call_of_posix(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(AS_ON_WINDOWS + WALK, encoding="utf-8")
    command = [sys.executable, "-X", "warn_default_encoding", str(script)]
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | LOCALE, capture_output=True, check=False
    )
    told = done.stderr.decode(errors="replace")
    assert done.returncode == 0, told
    assert not re.search(r"mlivr_gym\S*: EncodingWarning", told)
    assert {"plän.json", "plan.png", "walk"} <= {path.name for path in tmp_path.iterdir()}
    assert b"\r" not in (tmp_path / "plän.json").read_bytes()


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
