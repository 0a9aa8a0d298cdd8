"""What a wheel and an sdist hold, what they need, and that an installed wheel works.

Symlinked folders make this worth guarding.
"""

import importlib.util
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from mlivr_gym import __version__
from mlivr_gym.cli.doctor import TESTED

ROOT = Path(__file__).parent.parent


def build(root, out, *what):
    """Build files of a folder, with the setuptools that PyTorch brings, not one to be fetched."""
    command = [sys.executable, "-m", "build", "--no-isolation", *what, "--outdir", str(out)]
    subprocess.run([*command, str(root)], check=True, capture_output=True)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Those of a copy in which large files are empty, since it takes long to pack them thrice."""
    out, root = tmp_path_factory.mktemp("dist"), tmp_path_factory.mktemp("copy") / "root"
    needless = (".*", "__pycache__", "build", "*.egg-info", "docs", "results")
    shutil.copytree(ROOT, root, symlinks=True, ignore=shutil.ignore_patterns(*needless))
    for path in (root / "envs_assets").iterdir():
        path.write_bytes(b"" if path.suffix in {".npz", ".pt"} else path.read_bytes())
    build(root, out, "--wheel")
    tree = next(out.glob("*.whl")).rename(out / "tree.zip")
    build(root, out)
    return tree, next(out.glob("*.whl")), next(out.glob("*.tar.gz"))


def contents(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return {
            name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name
        }


def test_the_wheel_holds_one_package_with_every_module_and_asset(built):
    """Whether it is built from the tree or from the sdist."""
    assert contents(built[0]) == contents(built[1])
    names = set(contents(built[1]))
    assert {name.split("/")[0] for name in names} == {"mlivr_gym"}
    for folder in ("mlivr_gym", "planners", "agents", "envs_assets"):
        prefix = "mlivr_gym" if folder == "mlivr_gym" else f"mlivr_gym/{folder}"
        for path in (ROOT / folder).iterdir():
            if path.suffix in {".py", ".json", ".md", ".pt", ".npz"} or path.name == "py.typed":
                assert f"{prefix}/{path.name}" in names


def test_the_sdist_has_no_links_out_of_itself_and_no_tests(built):
    """They need the pages and the experiments, so they run in the repository alone."""
    with tarfile.open(built[2]) as archive:
        assert all(not (member.issym() or member.islnk()) for member in archive.getmembers())
        names = [name.split("/", 1)[-1] for name in archive.getnames()]
    assert "MANIFEST.in" in names
    assert not [name for name in names if name.startswith("tests")]


@pytest.mark.slow
def test_an_installed_wheel_plans(tmp_path):
    build(ROOT, tmp_path, "--wheel")
    target, wheel = tmp_path / "site", next(tmp_path.glob("*.whl"))
    line = f"-m pip install --quiet --no-deps --target {target} {wheel}"
    subprocess.run([sys.executable, *line.split()], check=True, capture_output=True)
    code = (
        f"import sys; sys.path.insert(0, {str(target)!r})\n"
        "import gymnasium, mlivr_gym\n"
        "from mlivr_gym.planners import Planner\n"
        f"assert mlivr_gym.__file__.startswith({str(target)!r})\n"
        "task = ('D2a:4', 'D2b:4'), (6.0, 0.0, 0.42), 'steps'\n"
        "plan = Planner(mlivr_gym.stance_graph()).plan(*task).unwrap()\n"
        "assert len(plan.steps) == 4\n"
        "gymnasium.make('MLIVR-JEM-v0').reset(seed=0)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)


@pytest.mark.parametrize("name", ["planners", "agents", "envs_assets"])
def test_bare_folders_refuse_to_be_imported(name):
    command = [sys.executable, "-c", f"import {name}"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert done.stderr.strip().splitlines()[-1].startswith(f"ImportError: import mlivr_gym.{name}:")


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CORE = {one.name: one for one in map(Requirement, PROJECT["dependencies"])}


def test_the_core_is_light_and_takes_any_newer_mujoco():
    heavy = {"pin", "coal", "torch", "dm-control", "stable-baselines3", "sb3-contrib", "minari"}
    assert not heavy & set(CORE)
    assert {s.operator for s in CORE["mujoco"].specifier} == {">="}
    assert Version("4.0.0") in CORE["mujoco"].specifier
    assert Version("3.16.0") not in CORE["mujoco"].specifier


def script(name):
    """A script of `.ci`, as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def release():
    return script("release")


def bounds(specifiers):
    """The oldest version that a requirement allows."""
    (oldest,) = [one.version for one in specifiers if one.operator == ">="]
    return Version(oldest)


def test_project_doctor_and_pages_tell_the_same_versions():
    """Doctor knows what was tested; the project allows nothing older, and the pages say it."""
    told = {name: tuple(map(Version, ends)) for name, ends in TESTED.items()}
    assert told.keys() - {"Python"} == CORE.keys()
    for name, requirement in CORE.items():
        oldest, newest = told[name]
        assert bounds(requirement.specifier) == oldest, name
        assert newest in requirement.specifier, name
    oldest, newest = TESTED["Python"]
    assert PROJECT["requires-python"] == f">={oldest}"
    minors = range(Version(oldest).minor, Version(newest).minor + 1)
    python = "Programming Language :: Python :: 3"
    classified = [one for one in PROJECT["classifiers"] if one.startswith(python)]
    assert classified == [python, *(f"{python}.{minor}" for minor in minors)]
    pages = [ROOT / "README.md", ROOT / "docs" / "install.md"]
    readme, install = [path.read_text(encoding="utf-8") for path in pages]
    for page in (readme, install):
        assert f"Python {oldest} to {newest}" in page
    rows = re.findall(r"^\| (\w+) \| ([\d.]+) \| ([\d.]+) \|$", install, re.MULTILINE)
    assert {name: ends for name, *ends in rows} == {n: list(ends) for n, ends in TESTED.items()}


def test_the_exact_versions_were_tested_and_lower_bounds_are_all_listed():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    exact = dict(line.split("==") for line in lines if "==" in line)
    for name, (oldest, newest) in TESTED.items():
        if name != "Python":
            found = Version(exact[name])
            assert Version(oldest) <= found, name
            assert found.release[:2] <= Version(newest).release, name
    listed = dict(line.split("==") for line in script("oldest").oldest(PROJECT))
    for name, requirement in CORE.items():
        assert Version(listed[name]) == bounds(requirement.specifier)
    assert {"torch", "viser", "dask"} <= listed.keys()
    assert not {"ruff", "sphinx"} & listed.keys()


def test_the_version_stands_in_one_place(release):
    assert release.version() == __version__
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    latest = re.search(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)[1]
    assert latest.split()[0] in (__version__, "Unreleased")


def test_what_readme_links_to_is_there_and_absolute_in_a_release(release):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 135
    targets = [path.split("#")[0] for _, _, path in release.LINK.findall(text)]
    assert len(targets) > 10
    assert not [path for path in targets if not (ROOT / path).exists()]
    base = "https://example.org/o/mlivr-gym"
    made = release.absolute(text, base, "v1.2.3")
    assert not release.LINK.findall(made)
    assert f"]({base}/raw/v1.2.3/results/walk/walk.gif)" in made
    assert f"]({base}/blob/v1.2.3/docs/tour.md)" in made


@pytest.mark.slow
def test_a_release_has_links_that_work_on_an_index(release, tmp_path):
    version = __version__  # that of `_version.py`, by which the wheel is named
    release.build("https://example.org/o/mlivr-gym", version, tmp_path)
    wheel, tables = sorted(tmp_path.glob("*.whl"))
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith("/METADATA"))
        told = archive.read(name).decode()
    assert "Project-URL: Repository, https://example.org/o/mlivr-gym\n" in told
    assert f"](https://example.org/o/mlivr-gym/blob/v{version}/docs/tour.md)" in told
    assert not release.LINK.findall(told.split("\n\n", 1)[1])
    first, second = contents(wheel), contents(tables)
    assert not first.keys() & second.keys()
    tables = [path for path in ROOT.glob("envs_assets/table-*.npz") if path.stat().st_size > 2e6]
    found = {f"mlivr_gym/{path.relative_to(ROOT)}" for path in tables}
    assert len(found) == 2
    assert second.keys() == found
    assert wheel.stat().st_size < 12e6
    assert max(path.stat().st_size for path in tmp_path.glob("mlivr_gym-*.tar.gz")) < 25e6


def test_what_the_demo_writes_is_ignored_by_git():
    """A fresh clone stays clean after `make demo`."""
    recipe = re.search(r"^demo:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.MULTILINE)[1]
    written = re.findall(r"(?:--out|>|-p) (\S+)", recipe)
    assert len(written) > 1
    for place in written:
        asked = ["git", "-C", str(ROOT), "check-ignore", "--quiet", f"{place}/any"]
        assert subprocess.run(asked, check=False).returncode == 0, place


def test_no_published_file_is_large():
    """They change with each release, and what was committed stays in every clone."""
    large = [path for path in (ROOT / "results").rglob("*") if path.stat().st_size > 1 << 20]
    if (ROOT / ".git").exists() and large:
        command = ["git", "ls-files", *map(str, large)]
        assert not subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout
