"""What is played of plans and executions."""

from dataclasses import replace

import numpy as np
import pytest
from plans import first_steps

from mlivr_gym.errors import PlanError
from mlivr_gym.simulation.execution import execute
from mlivr_gym.viewer.frames import (
    AT_REST,
    STEP_TIME,
    load_recording,
    plan_frames,
    recording_frames,
    stance_frames,
)


def test_a_plan_is_played_from_stance_to_stance(checked_graph, walk):
    """At the start of each step the robot is in the plan's configuration."""
    frames = plan_frames(checked_graph, walk)
    starts = frames.starts()
    np.testing.assert_allclose(starts, STEP_TIME * np.arange(len(walk.stances)))
    for k, time in enumerate(starts):
        shown, planned = frames.configuration(frames.at(time)), walk.configuration(k)
        np.testing.assert_allclose(shown[0], planned[0], atol=1e-6)
        assert abs(shown[1] @ planned[1]) == pytest.approx(1.0)  # either sign is the same turn
        np.testing.assert_allclose(shown[2], planned[2], atol=1e-6)


def test_a_plan_that_cannot_be_followed_shows_its_stances(checked_graph, walk, monkeypatch):
    def refuse(*_):
        raise PlanError("no swing")

    monkeypatch.setattr("mlivr_gym.viewer.frames.trajectory", refuse)
    frames = plan_frames(checked_graph, walk)
    assert len(frames) == 5
    assert (frames.phase == AT_REST).all()
    assert [frames.describe(k, walk) for k in (0, 4)] == ["stance 0 of 4", "stance 4 of 4"]
    np.testing.assert_array_equal(frames.joint_positions, stance_frames(walk).joint_positions)


@pytest.fixture(scope="module")
def execution(checked_graph, walk):
    return execute(checked_graph, first_steps(walk, 1))


def test_an_execution_is_played_as_it_was_recorded(execution, tmp_path):
    execution.save(tmp_path / "simulation.npz")
    recording = load_recording(tmp_path / "simulation.npz", execution.plan)
    frames = recording_frames(recording)
    assert frames.times[0] == 0.0
    span = execution.recording.times[-1] - execution.recording.times[0]
    assert frames.duration == pytest.approx(span)
    end = execution.plan.configuration(1)
    np.testing.assert_allclose(frames.base_positions[-1], end[0], atol=1e-3)
    np.testing.assert_allclose(frames.joint_positions[-1], end[2], atol=1e-2)


def test_measurements_of_something_else_are_refused(execution, walk, tmp_path):
    execution.save(tmp_path / "simulation.npz")
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(PlanError, match="cannot read simulation"):
        load_recording(tmp_path / "text.npz", walk)
    with pytest.raises(PlanError, match="cannot read simulation"):
        load_recording(tmp_path / "nowhere.npz", walk)
    robot = replace(walk.world.robot, limbs=3)
    other = replace(walk, world=replace(walk.world, robot=robot))
    with pytest.raises(PlanError, match=r"does not belong to the plan: joint_positions"):
        load_recording(tmp_path / "simulation.npz", other)
    with pytest.raises(PlanError, match="which has 0 steps"):
        load_recording(tmp_path / "simulation.npz", first_steps(walk, 0))
