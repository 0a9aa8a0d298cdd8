"""Each extension can be taken away: the core goes on, and knows nothing of it any more."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAMES = sorted(path.parent.name for path in (ROOT / "mlivr_gym" / "extensions").glob("*/*.py"))

CORE = """
import sys
from importlib import import_module
from pkgutil import walk_packages

import gymnasium
import mlivr_gym
from mlivr_gym.cli.main import every_command, main

gone = sys.argv[1]
assert mlivr_gym.__file__.startswith(sys.argv[2])
extra = {"dm_env", "minari", "sb3_contrib", "stable_baselines3", "torch", "trimesh", "viser"}
for module in walk_packages(mlivr_gym.__path__, "mlivr_gym."):
    try:
        import_module(module.name)
    except ImportError as error:
        assert str(error.name).split(".")[0] in extra, error
assert not [name for name in sys.modules if name.startswith(f"mlivr_gym.extensions.{gone}")]
assert not [name for name, (place, _) in every_command().items() if f".{gone}." in place]
for spec in gymnasium.registry.values():
    if spec.id.startswith("MLIVR"):
        import_module(spec.entry_point.split(":")[0])
points = [{"id": f"P{k}", "face": "deck", "position": [0.4 * k, 0, 0], "normal": [0, 0, 1],
           "rail": [1, 0, 0]} for k in range(4)]
deck = mlivr_gym.GraspMap.from_dict({"name": "deck", "points": points})
settings = mlivr_gym.Settings(manipulability=False, collisions=False)
graph = mlivr_gym.stance_graph(deck, settings=settings)
goal = graph.base_position[-1]
assert mlivr_gym.Planner(graph).plan(graph.points[0].tolist(), goal, "steps").unwrap().steps
"""


@pytest.mark.parametrize("name", sorted(set(NAMES)))
def test_the_core_goes_on_without_an_extension(name, tmp_path):
    ignored = shutil.ignore_patterns("__pycache__", "envs_assets")
    shutil.copytree(ROOT / "mlivr_gym", tmp_path / "mlivr_gym", ignore=ignored)
    (tmp_path / "mlivr_gym" / "envs_assets").symlink_to(ROOT / "envs_assets")
    shutil.rmtree(tmp_path / "mlivr_gym" / "extensions" / name)
    command = [sys.executable, "-c", CORE, name, str(tmp_path)]
    quick = os.environ | {"PYTHONPATH": "", "NUMBA_DISABLE_JIT": "1"}  # which caches no copy
    done = subprocess.run(command, cwd=tmp_path, env=quick, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
