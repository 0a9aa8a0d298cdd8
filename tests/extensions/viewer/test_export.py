"""The file that plays without a server."""

import re

import numpy as np
import pytest
from recordings import recording_of

pytest.importorskip("viser", reason="the extra 'viewer' is not installed")

from mlivr_gym.extensions.viewer import drawing
from mlivr_gym.extensions.viewer import viewer as export
from mlivr_gym.extensions.viewer.frames import load_frames

pytestmark = pytest.mark.usefixtures("scenes_made_once")


def test_a_plan_is_one_file_below_two_megabytes(checked_graph, walk, tmp_path):
    path = tmp_path / "walk.html"
    size = export.write_html(path, checked_graph, walk)
    assert size == path.stat().st_size <= 2_000_000
    text = path.read_text(encoding="utf-8")
    # Names of standards apart, nothing is named that could be fetched.
    fetched = re.findall(r"""(?:src|href)=["']?(https?://[^"' >]+)""", text)
    assert not fetched


def test_a_step_of_a_plan_is_played_in_five_seconds(checked_graph, walk, tmp_path, monkeypatch):
    told = []

    def noted(page, times, period, *others):
        told.append((times[0], times[-1], period * (len(times) - 1)))
        return ""

    monkeypatch.setattr(export.Page, "record", noted)
    export.write_html(tmp_path / "walk.html", checked_graph, walk)
    assert told == [(0.0, pytest.approx(20.0), pytest.approx(20.0))]


def test_an_execution_shows_what_was_recorded(checked_graph, walk, tmp_path, monkeypatch):
    """Every pose that is drawn is one of the recording, from its first to its last."""
    recording, drawn = recording_of(walk), []
    pose_robot = drawing.pose_robot

    def noted(page, model, configuration):
        drawn.append(configuration)
        pose_robot(page, model, configuration)

    monkeypatch.setattr(drawing, "pose_robot", noted)
    np.savez(tmp_path / "simulation.npz", **recording.arrays())
    frames = load_frames(tmp_path / "simulation.npz", walk)
    export.write_html(tmp_path / "walk.html", checked_graph, walk, frames)
    poses = np.concatenate(
        [recording.base_positions, recording.joint_positions.reshape(len(recording.times), -1)],
        axis=1,
    )
    shown = np.array([np.append(position, joints.ravel()) for position, _, joints in drawn])
    away = np.abs(poses[:, None] - shown[None]).max(axis=2)
    assert away.min(axis=0).max() < 1e-6
    assert (away.argmin(axis=0)[0], away.argmin(axis=0)[-1]) == (0, len(poses) - 1)
