"""If sensing or planning fails, the robot stops and holds all its points."""

import re

import numpy as np
import pytest
from loop_walks import BAG, CAMERA, GOAL, START

from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.closed_loop import loop
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.loop import run_closed_loop
from mlivr_gym.extensions.closed_loop.record import STOPPED
from mlivr_gym.planners import Planner


class FaultyCamera(DepthCamera):
    """Cameras that measure no numbers from a time on, or raise an error."""

    def measure(self, model, data, robot, rng, pixels):
        look = super().measure(model, data, robot, rng, pixels)
        if data.time >= self.at and self.fault is not None:
            raise self.fault
        blank = look._replace(hits=np.full_like(look.hits, np.nan))
        return blank if data.time >= self.at else look


@pytest.fixture
def loops(monkeypatch):
    """The loops that are run during a test."""
    found, made = [], loop._Loop.__init__

    def noted(self, *given):
        found.append(self)
        made(self, *given)

    monkeypatch.setattr(loop._Loop, "__init__", noted)
    return found


FAULTS = {
    None: "hits has .*not finite",
    SettingError("no picture"): "no picture",
    RuntimeError("no picture"): "no picture",
}
"""What cameras do, and what is told."""


@pytest.mark.parametrize(("at", "is_known"), [(0.0, False), (2.0, False), (0.0, True)])
@pytest.mark.parametrize("fault", FAULTS, ids=repr)
def test_cameras_that_fail_leave_the_robot_on_all_its_points(
    graph, monkeypatch, loops, at, is_known, fault
):
    """At rest, and during the first swing, among things that a blind robot would touch.

    Those that it knows it looks at before it plans. What is no error of the package is not hidden.
    """
    monkeypatch.setattr(FaultyCamera, "at", at, raising=False)
    monkeypatch.setattr(FaultyCamera, "fault", fault, raising=False)
    among = {"unknown": [] if is_known else [BAG], "camera": FaultyCamera(pixels=28, period=0.5)}
    graph.add_obstacles([BAG] if is_known else [])
    try:
        if isinstance(fault, RuntimeError):
            with pytest.raises(RuntimeError, match=FAULTS[fault]):
                run_closed_loop(graph, START, GOAL, **among)
            return
        record = run_closed_loop(graph, START, GOAL, **among)
    finally:
        graph.remove_obstacles()
        assert loops[0]._executor.simulation.points == list(graph.indices(START))
    assert (record.outcome, record.steps, record.proved) == (STOPPED, 0, False)
    assert re.match(f"sensing or planning failed: {FAULTS[fault]}", record.reason)
    assert record.duration >= at


def test_planning_that_fails_leaves_the_robot_on_all_its_points(graph, monkeypatch):
    """At the first grasp after the start."""

    def failing(planner, *given, **options):
        raise SettingError("no memory")

    monkeypatch.setattr(Planner, "remainder", failing)
    record = run_closed_loop(graph, START, GOAL, camera=CAMERA)
    assert record.outcome == STOPPED
    assert record.reason == "sensing or planning failed: no memory"
    assert not record.proved
