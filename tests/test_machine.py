"""The tests run with whatever packages and memory a machine has."""

import subprocess
import sys
from pathlib import Path

import pytest
from machine import MAY_BE_MISSING

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
