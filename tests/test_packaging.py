"""What a wheel and an sdist hold, and that an installed wheel works. Symlinked folders make this worth guarding."""

import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--outdir", str(out)]
    subprocess.run([*command, "--wheel", str(ROOT)], check=True, capture_output=True)
    tree = next(out.glob("*.whl")).rename(out / "tree.zip")
    subprocess.run([*command, str(ROOT)], check=True, capture_output=True)
    return tree, next(out.glob("*.whl")), next(out.glob("*.tar.gz"))


def contents(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name}


def test_the_wheel_has_one_top_level_package(built):
    assert {name.split("/")[0] for name in contents(built[1])} == {"mlivr_gym"}


def test_wheels_from_sdist_and_tree_are_equal(built):
    assert contents(built[0]) == contents(built[1])


def test_the_wheel_holds_every_module_and_asset(built):
    names = set(contents(built[1]))
    for folder, prefix in (
        ("mlivr_gym", ""),
        ("planners", "planners/"),
        ("agents", "agents/"),
        ("envs_assets", "envs_assets/"),
    ):
        for path in (ROOT / folder).iterdir():
            if path.suffix in {".py", ".json", ".pt"} or path.name == "py.typed":
                assert f"mlivr_gym/{prefix}{path.name}" in names


def test_the_sdist_has_no_links_out_of_itself(built):
    with tarfile.open(built[2]) as archive:
        assert all(not (member.issym() or member.islnk()) for member in archive.getmembers())


def test_an_installed_wheel_plans(built, tmp_path):
    target = tmp_path / "site"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(target), str(built[1])]
    subprocess.run(command, check=True, capture_output=True)
    code = (
        f"import sys; sys.path.insert(0, {str(target)!r})\n"
        "import gymnasium, mlivr_gym\n"
        "from mlivr_gym.planners import Planner\n"
        f"assert mlivr_gym.__file__.startswith({str(target)!r})\n"
        "plan = Planner(mlivr_gym.stance_graph()).plan(('D2a:4', 'D2b:4'), (6.0, 0.0, 0.42), cost='steps').unwrap()\n"
        "assert len(plan.steps) == 4\n"
        "gymnasium.make('MLIVR-JEM-v0').reset(seed=0)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)


@pytest.mark.parametrize("name", ["planners", "agents", "envs_assets"])
def test_bare_folders_refuse_to_be_imported(name):
    done = subprocess.run(
        [sys.executable, "-c", f"import {name}"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert done.stderr.strip().splitlines()[-1].startswith(f"ImportError: import mlivr_gym.{name}:")
