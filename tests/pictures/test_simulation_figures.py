"""The figure of an execution shows the numbers that it stands for."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from recordings import resting

from mlivr_gym.pictures import simulation_figures as module
from mlivr_gym.pictures.simulation_figures import SHADES, simulation_figure
from mlivr_gym.robot.visuals import LIMB_COLOURS
from mlivr_gym.simulation.recording import Capture, Failure


@pytest.fixture
def kept(monkeypatch):
    """The figures that would be written."""
    figures = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: figures.append(figure))
    return figures


@pytest.fixture
def recording():
    """A step of 20 s at random, of which the phases end at 5 s and 15 s, and a capture at 20 s."""
    rng, times = np.random.default_rng(0), 0.1 * np.arange(230)
    return replace(
        resting(len(times)),
        times=times,
        phase=(times > 4.95).astype(int) + (times > 14.95),
        joint_torques=rng.normal(size=(len(times), 2, 6)),
        grasp_forces=rng.normal(size=(len(times), 2, 3)),
        base_errors=1e-3 * rng.uniform(size=len(times)),
    )


CAPTURE = Capture(20.0, 0, 1, "D2a:4", 0.001, 0.01)


def curves(panel):
    """Lines along the whole recording, by colour."""
    return {to_hex(line.get_color()): line for line in panel.lines if len(line.get_xdata()) > 99}


def test_an_execution_is_drawn_as_it_was_recorded(kept, recording, tmp_path):
    failure = Failure("collision", 21.5, 0, "swing", -1, "it touches", {})
    simulation_figure(recording, (CAPTURE,), failure, tmp_path / "x.png", "A walk")
    (figure,) = kept
    whole, largest, forces, errors = figure.axes
    (rms,) = curves(whole).values()
    mean = [np.mean(torques**2) for torques in recording.joint_torques]
    np.testing.assert_allclose(rms.get_xydata(), np.transpose([recording.times, np.sqrt(mean)]))
    for limb in range(2):
        colour = to_hex(LIMB_COLOURS[limb])
        torques = [np.abs(one).max() for one in recording.joint_torques[:, limb]]
        np.testing.assert_allclose(curves(largest)[colour].get_ydata(), torques)
        assert curves(largest)[colour].get_label() == f"limb {limb}"
        force = [np.sqrt(one @ one) for one in recording.grasp_forces[:, limb]]
        np.testing.assert_allclose(curves(forces)[colour].get_ydata(), force)
    (millimetres,) = curves(errors).values()
    np.testing.assert_allclose(millimetres.get_ydata(), 1e3 * recording.base_errors)
    for panel in figure.axes:
        spans = {to_hex(span.get_facecolor()): span for span in panel.patches}
        for phase, begin, end in ((0, 0.0, 4.9), (2, 15.0, 22.9)):
            span = spans[SHADES[phase][1]]
            assert (span.get_x(), span.get_width()) == pytest.approx((begin, end - begin))
        marked = [line.get_xdata()[0] for line in panel.lines if len(line.get_xdata()) == 2]
        assert {20.0, 21.5} <= set(marked)
    assert "failed at 21.50 s: it touches" in [text.get_text() for text in figure.texts]


def test_a_spike_at_a_capture_is_cut_off_and_its_height_written(kept, recording, tmp_path):
    forces = np.clip(recording.grasp_forces, -1.0, 1.0)
    forces[205] = (30.0, 0.0, 40.0)
    recording = replace(recording, grasp_forces=forces)
    simulation_figure(recording, (CAPTURE,), None, tmp_path / "x.png", "A walk")
    panel = kept[0].axes[2]
    usual = np.linalg.norm(np.delete(forces, range(200, 210), axis=0), axis=2).max()
    assert panel.get_ylim() == pytest.approx((0.0, 1.45 * usual))
    assert [text.get_text() for text in panel.texts] == ["\u2191 50"]
