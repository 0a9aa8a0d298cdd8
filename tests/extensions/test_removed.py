"""Each extension can be taken away: the core goes on, and knows nothing of it any more."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
NAMES = {path.parent.name for path in (ROOT / "mlivr_gym" / "extensions").glob("*/*.py")}

CORE = """
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import gymnasium

extra = {"dm_env", "minari", "sb3_contrib", "stable_baselines3", "torch", "trimesh", "viser"}
points = [{"id": f"P{k}", "face": "deck", "position": [0.4 * k, 0, 0], "normal": [0, 0, 1],
           "rail": [1, 0, 0]} for k in range(4)]


def goes_on(folder):
    sys.path[0] = str(folder)
    import mlivr_gym
    from mlivr_gym.cli.main import every_command

    assert mlivr_gym.__file__.startswith(str(folder))
    for module in walk_packages(mlivr_gym.__path__, "mlivr_gym."):
        try:
            import_module(module.name)
        except ImportError as error:
            assert str(error.name).split(".")[0] in extra, error
    gone = f"mlivr_gym.extensions.{folder.name}"
    assert not [name for name in sys.modules if name.startswith(gone)]
    assert not [name for name, (place, _) in every_command().items() if place.startswith(gone)]
    for spec in gymnasium.registry.values():
        if spec.id.startswith("MLIVR"):
            import_module(spec.entry_point.split(":")[0])
    deck = mlivr_gym.GraspMap.from_dict({"name": "deck", "points": points})
    settings = mlivr_gym.Settings(manipulability=False, collisions=False)
    graph = mlivr_gym.stance_graph(deck, settings=settings)
    goal = graph.base_position[-1]
    assert mlivr_gym.Planner(graph).plan(graph.points[0].tolist(), goal, "steps").unwrap().steps


for folder in map(Path, sys.argv[1:]):
    goes_on(folder)
    # The next one begins without this package; other packages stay, which saves most of the time.
    for name in [name for name in sys.modules if name.split(".")[0] == "mlivr_gym"]:
        del sys.modules[name]
    for name in [name for name in gymnasium.registry if name.startswith("MLIVR")]:
        del gymnasium.registry[name]
    print(folder.name)
"""


def test_the_core_goes_on_without_an_extension(tmp_path):
    ignored = shutil.ignore_patterns("__pycache__", "envs_assets")
    for name in NAMES:
        package = tmp_path / name / "mlivr_gym"
        shutil.copytree(ROOT / "mlivr_gym", package, ignore=ignored)
        (package / "envs_assets").symlink_to(ROOT / "envs_assets")
        shutil.rmtree(package / "extensions" / name)
    folders = [str(tmp_path / name) for name in sorted(NAMES)]
    quick = os.environ | {"PYTHONPATH": "", "NUMBA_DISABLE_JIT": "1"}  # which caches no copy
    done = subprocess.run(
        [sys.executable, "-c", CORE, *folders], cwd=tmp_path, env=quick, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == sorted(NAMES)
