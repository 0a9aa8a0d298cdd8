"""What a station feels of a walk agrees with the momentum of the robot and with known signals."""

import json
from dataclasses import replace

import numpy as np
import pytest
from plans import first_steps
from recordings import resting
from scipy.integrate import cumulative_trapezoid

from mlivr_gym.cli.main import main
from mlivr_gym.errors import MlivrError
from mlivr_gym.extensions.station_load import StationLoad, limits
from mlivr_gym.extensions.station_load import load as module
from mlivr_gym.extensions.station_load.load import load_recording
from mlivr_gym.extensions.station_load.spectra import station_load, third_octaves
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.parameters import CONTROLLERS, Limits, Physics
from mlivr_gym.simulation.simulator import Simulation


@pytest.fixture(scope="module")
def plan(walk):
    return first_steps(walk, 1)


@pytest.fixture(scope="module")
def simulation(jem, plan):
    """With a time step at which MuJoCo conserves momentum to 3 %; the error grows with it."""
    return Simulation(
        jem, plan.world.robot, Physics(timestep=0.0002), controller=CONTROLLERS["feedforward"]
    )


@pytest.fixture(scope="module")
def walked(checked_graph, plan, simulation):
    return execute(checked_graph, plan, Limits(step_duration=12.0), simulation=simulation)


def test_the_station_gains_the_momentum_that_the_robot_loses(walked, simulation, plan):
    """Free of gravity and contacts, nothing but the grasp exchanges momentum with it."""
    recording, model, limb = walked.recording, simulation.model, 1 - plan.steps[0].limb
    tool = simulation.data.site(f"limb{limb}/anchor").xmat.reshape(3, 3)
    data, robot, angular = mujoco.MjData(model), model.body("base").id, []
    for position, quaternion, joints, momentum, about_centre in zip(
        recording.base_positions, recording.base_quaternions, recording.joint_positions,
        recording.momenta, recording.angular_momenta, strict=True,
    ):  # fmt: skip
        data.qpos[:] = [*position, *quaternion, *joints.ravel()]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        angular.append(about_centre + np.cross(data.subtree_com[robot], momentum))
    load = station_load(recording)
    for momenta, impulses, exchanged in (
        (recording.momenta, load.impulses, recording.module_forces),
        (recording.momenta, load.impulses, -recording.grasp_forces[:, limb] @ tool.T),
        (np.array(angular), load.angular_impulses, recording.module_torques),
    ):
        lost = momenta[0] - momenta
        gained = cumulative_trapezoid(exchanged, recording.times, axis=0, initial=0.0)
        assert np.abs(lost).max() > 0.1
        assert np.abs(gained - lost).max() < 0.03 * np.abs(lost).max()
        assert impulses[0] == pytest.approx(np.linalg.norm(lost, axis=1).max(), rel=0.03)
    assert load.peak_forces[0] == pytest.approx(np.linalg.norm(load.forces, axis=1).max())
    assert load.peak_torques[0] == pytest.approx(np.linalg.norm(load.torques, axis=1).max())


def test_a_known_force_has_its_peaks_impulses_and_accelerations():
    """Two steps of 60 s: a constant load, then a sine of 0.5 Hz, whose impulse is 2 F / omega."""
    times, omega = 0.02 * np.arange(6001), np.pi
    late = times >= 60.0
    force = np.where(late, 8.0 * np.sin(omega * (times - 60.0)), 0.5)
    turns = np.outer(np.where(late, 0.25, 3.0), (2.0, 1.0, 2.0)) / 3.0
    recording = replace(
        resting(len(times)), times=times, step=late.astype(int),
        module_forces=np.outer(force, (0.6, 0.0, 0.8)), module_torques=turns,
    )  # fmt: skip
    load = station_load(recording, 1e5)
    np.testing.assert_allclose(load.peak_forces, [0.5, 8.0], rtol=2e-3)
    np.testing.assert_allclose(load.peak_torques, [3.0, 0.25])
    np.testing.assert_allclose(load.impulses, [0.5 * 59.98, 2.0 * 8.0 / omega], rtol=1e-3)
    np.testing.assert_allclose(load.angular_impulses, [3.0 * 59.98, 0.25 * 60.0], rtol=1e-6)
    # The window of 100 s with all of the sine has it for 60 s; its ends spread over some bands.
    near = load.accelerations[np.abs(np.log10(load.frequencies / 0.5)) < 0.35]
    expected = 8.0 / np.sqrt(2.0) * np.sqrt(0.6) / (1e5 * 9.80665)
    assert np.sqrt((near**2).sum()) == pytest.approx(expected, rel=5e-3)
    for wrong in (0.0, -1.0, np.nan, "heavy"):
        with pytest.raises(MlivrError, match="mass"):
            station_load(recording, wrong)


def test_a_burst_is_in_one_window_wherever_it_is():
    """Windows overlap by half, so that one of them has all of a burst of half its length."""
    times = np.arange(0.0, 200.0, 0.02)
    burst = np.sin(2.0 * np.pi * 2.0 * times) * (np.abs(times - 100.0) < 25.0)
    _, squares = third_octaves(np.outer(burst, (1.0, 0.0, 0.0)), 0.02)
    assert np.sqrt((squares**2).sum()) == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("duration", [100.0, 250.0])
def test_a_sine_has_its_root_mean_square_in_one_band(duration):
    times = np.arange(0.0, duration, 0.02)
    signal = np.outer(np.sin(2.0 * np.pi * 2.0 * times), (3.0, 0.0, 4.0))
    frequencies, squares = third_octaves(signal, 0.02)
    at = np.argmin(np.abs(frequencies - 2.0))
    assert frequencies[at] == pytest.approx(1.995, abs=1e-3)  # IEC 61260-1
    assert squares[at] == pytest.approx(5.0 / np.sqrt(2.0), rel=1e-3)
    assert np.delete(squares, at).max() < 1e-3


def test_the_bands_together_have_the_mean_square_of_the_signal():
    """Parseval's theorem, for a signal of half the window."""
    times = np.arange(0.0, 50.0, 0.02)
    rng, signal = np.random.default_rng(1), np.zeros((len(times), 3))
    for frequency in rng.uniform(0.05, 15.0, 200):
        phases = rng.uniform(0.0, 2.0 * np.pi, 3)
        signal += np.sin(2.0 * np.pi * frequency * times[:, None] + phases)
    _, values = third_octaves(signal, 0.02)
    expected = 0.5 * (signal**2).sum(axis=1).mean()
    assert (values**2).sum() == pytest.approx(expected, rel=0.02)


def test_the_limits_are_the_published_ones_and_the_worst_band_decides():
    """Rows of the curve in the source that `station_load` names: middle of the band and limit."""
    published = [(0.0098, 1.8e-6), (0.1, 1.8e-6), (0.5, 9e-6), (10.0, 1.8e-4), (128.0, 1.8e-3)]
    frequencies, allowed = np.array(published).T
    assert limits(frequencies) == pytest.approx(allowed, rel=1e-12)
    # The band that comes nearest to its limit decides, not the one that shakes most.
    load = station_load(replace(resting(2), times=np.array([0.0, 0.1])))
    frequencies, allowed = np.array([0.1, 1.0, 10.0]), np.array([1.8e-6, 1.8e-5, 1.8e-4])
    for shares in ([0.5, 0.1, 0.2], [0.1, 0.7, 0.3], [0.2, 0.1, 0.9]):
        found = replace(load, frequencies=frequencies, accelerations=allowed * shares)
        assert found.largest_ratio == pytest.approx(max(shares))


def test_the_command_reads_what_an_execution_has_written(walked, tmp_path, capsys):
    walked.save(tmp_path / "simulation.npz")
    assert main(["load", str(tmp_path), "--mass", "42e4", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    load = station_load(walked.recording)
    assert told["largest_ratio_to_limit"] == pytest.approx(load.largest_ratio)
    assert (tmp_path / "station.png").read_bytes().startswith(b"\x89PNG")


def test_a_file_that_is_no_recording_is_refused(walked, tmp_path):
    recording = walked.recording
    np.savez(tmp_path / "few.npz", times=recording.times)
    with pytest.raises(MlivrError, match="cannot read simulation"):
        load_recording(tmp_path / "few.npz")
    for name in ("step", "module_forces", "module_torques"):
        whole = recording.arrays()
        for wrong in (whole[name][1:], whole[name].astype(str)):
            np.savez(tmp_path / "wrong.npz", **whole | {name: wrong})
            with pytest.raises(MlivrError, match=rf"wrong\.npz.*{name}"):
                load_recording(tmp_path / "wrong.npz")


def test_the_load_of_a_station_is_drawn_with_its_limit(tmp_path, monkeypatch):
    rng, times = np.random.default_rng(1), 0.1 * np.arange(200)
    bands = 10.0 ** np.arange(-2.0, 1.0, 0.1)
    load = StationLoad(
        times, *rng.normal(size=(2, 200, 3)), *np.zeros((4, 1)), bands,
        1e-6 * rng.uniform(0.1, 1.0, len(bands)),
    )  # fmt: skip
    kept = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: kept.append(figure))
    module.load_figure(load, tmp_path / "x.png", "A load")
    by_name = {axes.get_ylabel(): axes for axes in kept[0].axes}
    for name, values in (("force [N]", load.forces), ("torque [N m]", load.torques)):
        lines = by_name.pop(name).lines
        assert [line.get_label() for line in lines] == ["x", "y", "z"]
        for line, value in zip(lines, values.T, strict=True):
            np.testing.assert_allclose(line.get_xydata(), np.transpose([times, value]))
    ((name, spectrum),) = by_name.items()
    assert name.endswith("[micro-g]")
    drawn = {line.get_label(): line.get_xydata() for line in spectrum.lines}
    np.testing.assert_allclose(drawn["walk"], np.transpose([bands, 1e6 * load.accelerations]))
    np.testing.assert_allclose(drawn["limit"], np.transpose([bands, 1e6 * limits(bands)]))
