"""Ways out of the lanes of crew members, against all sequences of steps on a small graph."""

from types import SimpleNamespace

import numpy as np
import pytest

from mlivr_gym.closed_loop import evasion
from mlivr_gym.closed_loop.evasion import PERIOD, Evasion
from mlivr_gym.transitions.state import State

TIMES = 14
STEPS = 2


class Corridor(Evasion):
    """Stances with given times at which they are safe; neighbours differ by one."""

    def __init__(self, safe):
        self.safe, self._times = safe, PERIOD * np.arange(safe.shape[1])
        self._graph, self._crew = self, ()

    def distances(self, state):
        return self.safe[state.stance[0]].astype(float)

    def successors(self, state):
        here = state.stance[0]
        others = [k for k in (here - 1, here + 1) if 0 <= k < len(self.safe)]
        after = lambda _, row: State((others[row],), (1,))  # noqa: E731
        return SimpleNamespace(base_position=np.zeros((len(others), 3)), after=after)

    def _farthest_first(self, positions, begin):
        return list(range(len(positions)))


def has_way(safe, is_optimistic):
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
            during = range(time + STEPS if is_optimistic else time, time + STEPS + 1)
            if 0 <= k < len(safe) and all(at(k, t) for t in during):
                todo.append((k, time + STEPS))
    return False


@pytest.mark.parametrize("is_optimistic", [False, True])
def test_a_way_is_found_if_any_sequence_of_steps_is_one(monkeypatch, is_optimistic):
    monkeypatch.setattr(evasion, "STEP_TIME", STEPS * PERIOD)
    monkeypatch.setattr(evasion, "LEAST_STEP_TIME", STEPS * PERIOD)
    rng, found = np.random.default_rng(1), []
    for _ in range(400):
        safe = rng.random((4, TIMES)) < 0.75
        safe[:, -1] = rng.random(4) < 0.5
        way = Corridor(safe).escape(State((0,), (1,)), 0.0, 0.5, is_optimistic=is_optimistic)
        assert bool(way.states) == has_way(safe, is_optimistic)
        assert way.states or way.is_exhausted
        found.append(bool(way.states))
    assert 40 < sum(found) < 360
