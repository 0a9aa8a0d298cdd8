"""The command `view`: what it writes, serves and refuses."""

import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest
from recordings import recording_of

from mlivr_gym.motion.plan import Plan

needs_viewer = pytest.mark.skipif(
    importlib.util.find_spec("viser") is None,
    reason="the extra 'viewer' is not installed",
)


@needs_viewer
def test_view_plans_first_if_it_is_given_a_query(run, tmp_path):
    out = tmp_path / "walk.html"
    query = ("--start", "D2a:4", "D2b:4", "--goal", "6.0", "0", "0.42", "--cost", "steps")
    code, told, _ = run("view", *query, "--out", str(out))
    assert code == 0
    assert told.startswith("4 steps")
    assert "<html" in out.read_text(encoding="utf-8")


@needs_viewer
def test_view_writes_nothing_where_there_is_no_plan(run, tmp_path):
    out = tmp_path / "walk.html"
    blocked = ("--start", "D2a:4", "D2b:4", "--goal", "1.0", "0", "0.42", "--tolerance", "0.001")
    code, _, told = run("view", *blocked, "--out", str(out))
    assert (code, out.exists()) == (3, False)
    assert "no stance" in told


def test_view_says_what_to_install(run, monkeypatch):
    monkeypatch.setattr("mlivr_gym.extras.importlib.util.find_spec", lambda name: None)
    code, _, told = run("view")
    assert code == 2
    assert "this needs the package 'viser': pip install 'mlivr-gym[viewer]'" in told


@needs_viewer
def test_view_writes_a_page_of_an_execution(run, plan_file, tmp_path):
    folder, out = tmp_path / "walk", tmp_path / "walk.html"
    folder.mkdir()
    shutil.copy(plan_file, folder / "plan.json")
    recording = recording_of(Plan.load(plan_file))
    np.savez_compressed(folder / "simulation.npz", **recording.arrays())
    assert run("view", "--execution", str(folder), "--out", str(out))[0] == 0
    assert out.exists()
    (folder / "simulation.npz").unlink()
    code, _, told = run("view", "--execution", str(folder), "--out", str(out))
    assert code == 2
    assert "simulation.npz" in told


@needs_viewer
def test_view_serves_this_computer_alone_until_it_is_interrupted(plan_file):
    command = [sys.executable, "-m", "mlivr_gym.cli.main", "view", "--plan", str(plan_file)]
    with subprocess.Popen(
        [*command, "--port", "0"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
        # What runs in the background of a shell begins with interrupts ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as served:  # fmt: skip
        first, second = served.stdout.readline(), served.stdout.readline()
        assert first.startswith("4 steps")
        address = re.search(r"page: (http://127\.0\.0\.1:\d+)", second).group(1)
        with urllib.request.urlopen(address) as answer:
            assert answer.status == 200
        served.send_signal(signal.SIGINT)
        _, told = served.communicate()
    assert served.returncode == 0
    # Where the machine is busy what takes long is told; nothing else is.
    lines = [line for line in told.splitlines() if not re.fullmatch(r".*, \d+ s", line)]
    assert not lines
