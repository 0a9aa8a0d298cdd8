"""The command `doctor`."""

import json
import os
import subprocess
import sys
from importlib import metadata

import pytest

from mlivr_gym.cli import doctor


@pytest.fixture(autouse=True)
def no_gl(monkeypatch):
    monkeypatch.setattr(doctor, "gl_fault", lambda name: "" if name == "egl" else "no library")


def test_doctor_tells_what_is_installed(run):
    code, out, _ = run("doctor", "--json")
    told = json.loads(out)
    assert code == 0
    assert told["core"]["numpy"] == metadata.version("numpy")
    assert {"agents", "data", "dm", "film", "dev"} <= set(told["extras"])
    assert told["gl"] == {"egl": "works", "glfw": "no library", "osmesa": "no library"}


def test_what_is_missing_is_told_with_the_command_that_installs_it(run, monkeypatch):
    needed = ["numpy>=2", "no-such-arm[x]<2,>=1; extra == 'agents'"]
    monkeypatch.setattr(doctor.metadata, "requires", lambda _: needed)
    code, out, _ = run("doctor")
    assert code == 0
    assert "extra [agents]: no-such-arm MISSING; pip install 'mlivr-gym[agents]'" in out
    monkeypatch.setattr(doctor.metadata, "requires", lambda _: ["no-such-core>=2"])
    code, out, _ = run("doctor")
    assert code == 1
    assert "required packages: no-such-core MISSING" in out
    assert "no-such-core is missing: pip install 'no-such-core>=0'" in out


@pytest.mark.parametrize(
    ("version", "fault", "code"),
    [
        ("1.26.4", "numpy 1.26.4 is too old: pip install 'numpy>=2.0'", 1),
        ("2.0.0", None, 0),
        ("2.99.1rc1", "numpy 2.99.1rc1 is newer than {}, the newest that was tested", 0),
    ],
)
def test_versions_out_of_the_tested_range_are_told(run, monkeypatch, version, fault, code):
    monkeypatch.setattr(doctor.metadata, "requires", lambda _: ["numpy<3,>=2.0"])
    monkeypatch.setattr(doctor.metadata, "version", lambda _: version)
    found, out, _ = run("doctor", "--json")
    told = json.loads(out)
    both = told["faults"] | told["untested"]
    assert found == code
    assert both.get("numpy") == (fault and fault.format(doctor.TESTED["numpy"][1])[6:])


def with_broken(folder, package, code, *words):
    """What a command prints where importing a package runs some code."""
    (folder / f"{package}.py").write_text(code, encoding="utf-8")
    paths = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.run(
        [sys.executable, "-m", "mlivr_gym", *words],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("package", "code", "fault"),
    [
        # As MuJoCo after an upgrade from 3 to 4 in place, whose advice does not mend it.
        (
            "mujoco",
            "raise ImportError('no core. Repair:\\n  so') from None",
            "ImportError: no core",
        ),
        ("matplotlib", "import os; os._exit(11)", "ended with exit code 11"),
    ],
)
def test_a_package_that_cannot_be_imported_is_told(tmp_path, package, code, fault):
    done = with_broken(tmp_path, package, code, "doctor")
    assert (done.returncode, done.stderr) == (1, "")
    remedy = f"pip install --force-reinstall {package}"
    told = f"  {package} {metadata.version(package)} is broken: {remedy} ({fault})"
    assert [one for one in done.stdout.splitlines() if one.startswith("  ")] == [told]


def test_other_commands_name_a_broken_package_in_one_line(tmp_path):
    done = with_broken(tmp_path, "numba", "raise ImportError('needs NumPy 2.2')", "info")
    told = "mlivr-gym: needs NumPy 2.2; `mlivr-gym doctor` tells what is wrong with packages\n"
    assert (done.returncode, done.stderr) == (1, told)


def test_a_cache_that_cannot_be_written_is_a_failure(run, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path / "file" / "cache"))
    code, out, _ = run("doctor", "--json")
    assert code == 1
    assert json.loads(out)["compiler"]["cache_can_be_written"] is False
