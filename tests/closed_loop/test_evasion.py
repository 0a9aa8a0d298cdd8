"""Ways out of the lanes of crew members, against all sequences of steps on a small graph."""

from types import SimpleNamespace

import numpy as np
import pytest

from mlivr_gym.closed_loop import evasion
from mlivr_gym.closed_loop.crew import CrewMember, distance_from_crew
from mlivr_gym.closed_loop.evasion import Evasion, Rest, _Edge
from mlivr_gym.closed_loop.path_check import PathCheck, robot_axes, robot_radii
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.step_executor import PreparedStep
from mlivr_gym.simulation.timing import step_trajectory
from mlivr_gym.transitions.state import State

TIMES = 14
STEP = 2


class Corridor(Evasion):
    """Stances with given times at which they are safe; neighbours differ by one."""

    def __init__(self, safe):
        self.safe, self.end, self.tried = safe, float(safe.shape[1] - 1), 0

    def is_safe(self, here, time):
        return bool(self.safe[here, min(int(time), self.safe.shape[1] - 1)])

    def _safe_until(self, rest, begin, kept):
        here = rest.state.stance[0]
        times = range(int(begin), self.safe.shape[1])
        unsafe = [t for t in times if not self.is_safe(here, t)]
        return float(unsafe[0]) if unsafe else np.inf if self.is_safe(here, begin) else begin

    def _edges(self, node, kept):
        here = node.rest.state.stance[0]
        others = [k for k in (here - 1, here + 1) if 0 <= k < len(self.safe)]
        return [(k % 2 == 0, _Edge(node, State((k,), ()), 0, k)) for k in others]

    def _tried(self, edge, margins):
        self.tried += 1
        trajectory = SimpleNamespace(joint_positions=np.zeros((1, 1, 6)))
        path = SimpleNamespace(times=np.arange(STEP + 1.0), towards=edge.point)
        prepared = PreparedStep(trajectory, edge.after)
        return self._arrivals(edge.arrival, prepared, path, margins)

    def _is_clear(self, path, begin, kept):
        return all(self.is_safe(path.towards, begin + t) for t in path.times)


def has_way(safe, delay):
    """Return whether any sequence of waits and steps leads to a stance that stays safe."""
    last = safe.shape[1] - 1
    at = lambda k, t: bool(safe[k, min(t, last)])  # noqa: E731
    todo, seen = [(0, 0)], set()
    while todo:
        here, time = todo.pop()
        if (here, time) in seen or not at(here, time):
            continue
        seen.add((here, time))
        if safe[here, min(time, last) :].all():
            return True
        todo.append((here, time + 1))
        for k in (here - 1, here + 1):
            during = range(time, time + STEP + delay + 1)
            if 0 <= k < len(safe) and all(at(k, t) for t in during):
                todo.append((k, time + STEP + delay))
    return False


@pytest.mark.parametrize("delay", [0, 1])
def test_a_way_is_found_if_any_sequence_of_steps_is_one(monkeypatch, delay):
    monkeypatch.setattr(evasion, "WAIT", 1.0)
    monkeypatch.setattr(evasion, "LEAST_STEP_TIME", float(STEP))
    rng, found, start = np.random.default_rng(1), [], Rest(State((0,), ()), np.zeros((1, 6)))
    for _ in range(400):
        safe = rng.random((4, TIMES)) < 0.75
        safe[:, -1] = rng.random(4) < 0.5
        corridor = Corridor(safe)
        way = corridor.escape(start, 0.0, (0.5, float(delay)), 1000)
        assert (way.steps is not None) == has_way(safe, delay)
        assert way.steps is not None or way.is_exhausted
        found.append(way.steps is not None)
        if way.steps:  # a search that may not try enough steps proves nothing
            assert corridor.escape(start, 0.0, (0.5, float(delay)), 0) == (None, False)
    assert 40 < sum(found) < 360


@pytest.fixture(scope="module")
def among_crew(checked_graph):
    """Ways out of a robot in the README's first stance, its posture, and who comes to its place."""
    state = checked_graph.state(("D2a:4", "D2b:4"))
    (x, _, z), _, joints = checked_graph.configuration(state)
    member = CrewMember((x, -4.0, z), (x, 4.0, z), begin=1.0)
    executor = SimpleNamespace(graph=checked_graph)
    return Evasion(executor, LimbShapes(checked_graph.robot), [member]), Rest(state, joints), member


def test_a_step_is_clear_up_to_its_distance_from_who_crosses(among_crew, checked_graph, walk):
    """By distances at every sample of its trajectory, not only at those that are compared."""
    ways, _, member = among_crew
    trajectory = step_trajectory(checked_graph, walk, 0, Limits())
    shapes = LimbShapes(checked_graph.robot)
    path = PathCheck(checked_graph, shapes, trajectory)
    rows = zip(
        trajectory.base_positions, trajectory.base_quaternions, trajectory.joint_positions,
        strict=True,
    )  # fmt: skip
    axes = np.array([robot_axes(checked_graph.robot, shapes, row) for row in rows])
    for begin in (0.0, 0.7, 1.4):
        times = begin + trajectory.times
        gap = distance_from_crew(axes, robot_radii(shapes), [member], times).min()
        assert gap > 0.2
        # In a tenth of a second who crosses moves by 5 cm, nearer or farther.
        assert ways._is_clear(path, begin, gap - 1e-9)
        assert not ways._is_clear(path, begin, gap + 0.026)


@pytest.mark.parametrize("kept", [0.05, 0.2, 0.4])
def test_a_rest_is_safe_until_who_comes_is_as_near_as_allowed(among_crew, checked_graph, kept):
    ways, rest, member = among_crew
    times = np.arange(0.0, 20.0, 0.01)
    shapes = LimbShapes(checked_graph.robot)
    axes = robot_axes(checked_graph.robot, shapes, checked_graph.configuration(rest.state))
    still = np.broadcast_to(axes, (len(times), *axes.shape))
    apart = distance_from_crew(still, robot_radii(shapes), [member], times)
    assert (apart < kept).any()
    first = times[np.argmax(apart < kept)]
    assert first > 1.0
    found = ways._safe_until(rest, 0.0, kept)
    assert first - 0.02 <= found <= first + evasion.PERIOD + 0.02
