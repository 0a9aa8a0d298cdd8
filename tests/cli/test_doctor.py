"""The command `doctor`."""

import json
from importlib import metadata

import pytest

from mlivr_gym.cli import doctor


@pytest.fixture
def no_gl(monkeypatch):
    monkeypatch.setattr(doctor, "gl_fault", lambda name: "" if name == "egl" else "no library")


def test_doctor_tells_what_is_installed(run, no_gl):
    code, out, _ = run("doctor", "--json")
    told = json.loads(out)
    assert code == 0
    assert told["core"]["numpy"] == metadata.version("numpy")
    assert {"agents", "data", "dm", "film", "dev"} <= set(told["extras"])
    assert told["gl"] == {"egl": "works", "glfw": "no library", "osmesa": "no library"}


@pytest.mark.usefixtures("no_gl")
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


@pytest.mark.usefixtures("no_gl")
def test_a_cache_that_cannot_be_written_is_a_failure(run, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path / "file" / "cache"))
    code, out, _ = run("doctor", "--json")
    assert code == 1
    assert json.loads(out)["compiler"]["cache_can_be_written"] is False


def test_a_backend_that_is_none_is_told_in_one_line():
    fault = doctor.gl_fault("crystal")
    assert "crystal" in fault
    assert "\n" not in fault
