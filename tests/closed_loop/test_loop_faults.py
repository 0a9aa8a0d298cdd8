"""If sensing or planning fails, the robot stops and holds all its points."""

import numpy as np
import pytest
from loop_walks import BAG, CAMERA, GOAL, START

from mlivr_gym import stance_graph
from mlivr_gym.closed_loop import loop
from mlivr_gym.closed_loop.depth_camera import DepthCamera
from mlivr_gym.closed_loop.loop import run_closed_loop
from mlivr_gym.closed_loop.record import STOPPED
from mlivr_gym.errors import SettingError
from mlivr_gym.planners import Planner


@pytest.fixture(scope="module")
def graph(jem):
    return stance_graph(jem)


class FaultyCamera(DepthCamera):
    """Cameras that raise an error, by `fault`, at a time."""

    def measure(self, model, data, robot, rng, pixels):
        if data.time >= self.at:
            raise self.fault
        return super().measure(model, data, robot, rng, pixels)


class BlankCamera(DepthCamera):
    """Cameras that measure no numbers from a time on."""

    def measure(self, model, data, robot, rng, pixels):
        look = super().measure(model, data, robot, rng, pixels)
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


@pytest.mark.parametrize(("at", "known", "unknown"), [(0.0, [], [BAG]), (2.0, [], [BAG]),
                                                      (0.0, [BAG], [])])  # fmt: skip
def test_cameras_without_numbers_leave_the_robot_on_all_its_points(
    graph, monkeypatch, loops, at, known, unknown
):
    """At rest, and during the first swing, among things that a blind robot would touch.

    Those that it knows it looks at before it plans.
    """
    monkeypatch.setattr(BlankCamera, "at", at, raising=False)
    graph.add_obstacles(known)
    camera = BlankCamera(period=0.5)
    try:
        record = run_closed_loop(graph, START, GOAL, unknown=unknown, camera=camera)
    finally:
        graph.remove_obstacles()
    assert (record.outcome, record.steps, record.proved) == (STOPPED, 0, False)
    assert "sensing or planning failed: hits has" in record.reason
    assert "not finite" in record.reason
    assert record.duration >= at
    assert loops[0]._executor.simulation.points == list(graph.indices(START))


@pytest.mark.parametrize("at", [0.0, 2.0])
@pytest.mark.parametrize("error", [SettingError, RuntimeError])
def test_cameras_that_fail_leave_the_robot_on_all_its_points(graph, monkeypatch, loops, at, error):
    """At rest, and during the first swing; what is no error of the package is not hidden."""
    camera = FaultyCamera(period=0.5)
    monkeypatch.setattr(FaultyCamera, "at", at, raising=False)
    monkeypatch.setattr(FaultyCamera, "fault", error("no picture"), raising=False)
    if error is RuntimeError:
        with pytest.raises(RuntimeError, match="no picture"):
            run_closed_loop(graph, START, GOAL, camera=camera)
    else:
        record = run_closed_loop(graph, START, GOAL, camera=camera)
        assert (record.outcome, record.steps, record.proved) == (STOPPED, 0, False)
        assert record.reason == "sensing or planning failed: no picture"
        assert record.duration >= at
    assert loops[0]._executor.simulation.points == list(graph.indices(START))


@pytest.mark.parametrize("called", [2, 3])
def test_planning_that_fails_leaves_the_robot_on_all_its_points(graph, monkeypatch, called):
    """At the first grasp after the start, and during the first step."""
    calls, plan = [], Planner.plan

    def failing(planner, *given, **options):
        calls.append(given)
        if len(calls) == called:
            raise SettingError("no memory")
        return plan(planner, *given, **options)

    monkeypatch.setattr(Planner, "plan", failing)
    record = run_closed_loop(graph, START, GOAL, camera=CAMERA)
    assert record.outcome == STOPPED
    assert record.reason == "sensing or planning failed: no memory"
    assert not record.proved
