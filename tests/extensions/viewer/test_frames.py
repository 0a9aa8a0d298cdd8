"""What is played of plans and executions."""

from dataclasses import fields, replace

import numpy as np
import pytest
from fuzz import loaded
from plans import first_steps

from mlivr_gym.errors import PlanError
from mlivr_gym.extensions.viewer.frames import (
    STEP_TIME,
    Frames,
    load_frames,
    plan_frames,
)
from mlivr_gym.files import FileError
from mlivr_gym.simulation.execution import execute


def test_a_plan_is_played_from_stance_to_stance(checked_graph, walk):
    """At the start of each step the robot is in the plan's configuration."""
    frames = plan_frames(checked_graph, walk)
    assert frames.duration == pytest.approx(STEP_TIME * len(walk.steps))
    for k, time in enumerate(STEP_TIME * np.arange(len(walk.stances))):
        shown, planned = frames.configuration(frames.at(time)), walk.configuration(k)
        np.testing.assert_allclose(shown[0], planned[0], atol=1e-6)
        assert abs(shown[1] @ planned[1]) == pytest.approx(1.0)  # either sign is the same turn
        np.testing.assert_allclose(shown[2], planned[2], atol=1e-6)


@pytest.fixture(scope="module")
def execution(checked_graph, walk):
    return execute(checked_graph, first_steps(walk, 1))


def test_recording_and_summary_are_saved_together_or_not_at_all(execution, tmp_path):
    (tmp_path / "simulation.json").mkdir()
    with pytest.raises(FileError, match="cannot write"):
        execution.save(tmp_path / "simulation.npz")
    assert not (tmp_path / "simulation.npz").exists()


def test_an_execution_is_played_as_it_was_recorded(execution, tmp_path):
    execution.save(tmp_path / "simulation.npz")
    frames = load_frames(tmp_path / "simulation.npz", execution.plan)
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
        load_frames(tmp_path / "text.npz", walk)
    with pytest.raises(PlanError, match="cannot read simulation"):
        load_frames(tmp_path / "nowhere.npz", walk)
    robot = replace(walk.world.robot, limbs=3)
    other = replace(walk, world=replace(walk.world, robot=robot))
    with pytest.raises(PlanError, match=r"joint_positions has shape"):
        load_frames(tmp_path / "simulation.npz", other)
    with pytest.raises(PlanError, match=r"step\[0\] is 0"):
        load_frames(tmp_path / "simulation.npz", first_steps(walk, 0))


def alter(arrays, rng):
    """Change an array that is played: its type, its shape, or a value, or leave it out."""
    name = rng.choice([field.name for field in fields(Frames)])
    array = arrays[name]
    ways = (
        lambda: array.astype(rng.choice(["f4", "i8", "u1", "U3", "?", "c16", "M8[s]"])),
        lambda: array[: rng.integers(3)],
        lambda: array[..., None],
        lambda: np.array(array.flat[0]),
        lambda: np.where(np.arange(array.size).reshape(array.shape) == 5, wrong, array),
        lambda: array[::-1],
        lambda: np.frombuffer(changed_word(array.tobytes(), rng), array.dtype),
        lambda: np.frombuffer(changed_word(array.tobytes(), rng), array.dtype).reshape(array.shape),
        lambda: None,
    )
    wrong = rng.choice([np.nan, np.inf, -1, 3, 1e300, -(2**40)])
    with np.errstate(all="ignore"):
        return {**arrays, name: ways[rng.integers(len(ways))]()}


def changed_word(content, rng):
    """Bytes of which eight in a row are others."""
    at = int(rng.integers(len(content) // 8)) * 8
    return content[:at] + rng.bytes(8) + content[at + 8 :]


@pytest.mark.filterwarnings("ignore:.*discards the imaginary part")
def test_an_altered_recording_is_played_or_refused_in_one_line(execution, tmp_path):
    execution.save(tmp_path / "simulation.npz")
    whole, rng = (tmp_path / "simulation.npz").read_bytes(), np.random.default_rng(0)
    with np.load(tmp_path / "simulation.npz") as data:
        arrays = dict(data)
    path, refused = tmp_path / "altered.npz", 0
    for k in range(300):
        if k % 3:
            kept = {name: one for name, one in alter(arrays, rng).items() if one is not None}
            np.savez(path, **kept)
        else:
            path.write_bytes(changed_word(whole, rng))

        def play(path):
            frames = load_frames(path, execution.plan)
            assert frames.duration >= 0.0
            assert all(np.isfinite(each).all() for each in frames.arrays().values())
            return [frames.describe(k, execution.plan) for k in range(len(frames.times))]

        refused += loaded(play, path, path.read_bytes()) is None
    assert refused > 150
