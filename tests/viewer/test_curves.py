"""Plots below the scrubber, compared with the plan's figures and with definitions."""

from dataclasses import replace

import numpy as np
import pytest
from recordings import recording_of

from mlivr_gym.viewer.curves import (
    Plot,
    limb_manipulabilities,
    margins,
    recorded,
    with_cursor,
)
from mlivr_gym.viewer.frames import plan_frames


def test_manipulability_of_limbs_is_the_plans(checked_graph, walk):
    """By Jacobians of the link frames, against the closed form that the plan carries."""
    found = limb_manipulabilities(checked_graph.robot, walk.motion.joint_positions)
    np.testing.assert_allclose(found, walk.motion.w_m, rtol=1e-9)


def test_margins_are_the_plans_in_stances(checked_graph, walk):
    frames = plan_frames(checked_graph, walk)
    limits = checked_graph.limb_threshold, checked_graph.base_threshold
    plot = margins(frames, walk)
    curves = {label: values for label, _, values in plot.curves}
    last = len(frames) - 1
    for limb in range(2):
        expected = walk.motion.w_m[[0, -1], limb] / limits[0]
        np.testing.assert_allclose(curves[f"limb {limb}"][[0, last]], expected, rtol=1e-6)
    at = [frames.at(time) for time in frames.starts()]
    np.testing.assert_allclose(curves["base, in stances"][at], walk.motion.w_b / limits[1])
    assert (curves["threshold"] == 1.0).all()
    floor = checked_graph.settings.path_floor / limits[0]
    assert (curves["path floor"] == floor).all()
    held = np.stack([curves["limb 0"], curves["limb 1"]])
    assert np.nanmin(held) >= floor


def test_a_limb_that_moves_has_no_margin(checked_graph, walk):
    frames = plan_frames(checked_graph, walk)
    curves = margins(frames, walk).curves
    k = frames.at(2.5)  # half-way through the first step
    limb = walk.steps[0].limb
    assert np.isnan(curves[limb][2][k])
    assert np.isfinite(curves[1 - limb][2]).all() or len({s.limb for s in walk.steps}) == 2
    assert np.isfinite(curves[1 - limb][2][k])


def test_without_thresholds_there_is_no_margin(checked_graph, walk):
    frames = plan_frames(checked_graph, walk)
    settings = replace(walk.world.settings, manipulability=False)
    plan = replace(walk, world=replace(walk.world, settings=settings))
    assert margins(frames, plan).curves == ()


def test_torques_and_forces_are_those_recorded(walk):
    recording = recording_of(walk)
    k, found = 17, recorded(recording)["torques"]
    assert found.times[0] == 0.0
    flat = recording.joint_torques[k].ravel()
    assert found.curves[0][2][k] == pytest.approx(np.sqrt(np.mean(flat**2)))
    assert found.curves[1][2][k] == pytest.approx(np.abs(flat).max())
    force = recorded(recording)["forces"].curves[1][2][k]
    assert force == pytest.approx(np.sqrt((recording.grasp_forces[k, 1] ** 2).sum()))


def test_the_cursor_is_an_upright_line_between_the_values():
    times = np.array([0.0, 1.0, 2.0])
    plot = Plot("p", times, (("a", "#000000", np.array([0.0, 2.0, 4.0])),))
    at, (values, line) = with_cursor(plot, 1.25)
    assert at.tolist() == [0.0, 1.0, 1.25, 1.25, 2.0]
    assert values.tolist() == [0.0, 2.0, 2.5, 2.5, 4.0]
    assert np.isnan(line).tolist() == [True, True, False, False, True]
    assert line[2:4].tolist() == [0.0, plot.highest]
    for now in (-1.0, 0.0, 2.0, 9.0):
        at, _ = with_cursor(plot, now)
        assert (np.diff(at) >= 0.0).all()
