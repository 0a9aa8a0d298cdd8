"""The steps of a state are the same to the last bit, whatever was asked before and where."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.table_build import find_table

WALKS, STEPS = 2, 3


def states_of(graph, seed):
    """States of random walks: those that a robot takes hold in, and what is left of them later."""
    rng, states = np.random.default_rng(seed), []
    for _ in range(WALKS):
        state = random_state(graph, rng)
        states.append(state)
        for _ in range(STEPS):
            steps = graph.successors(state)
            if not steps:
                break
            state = steps.after(state, int(rng.integers(len(steps.limb))))
            states.append(state)
    return states


def digest(graph, states):
    """Digest of all numbers of the steps that leave some states."""
    found = hashlib.sha256()
    for state in states:
        for part in graph.successors(state):
            found.update(np.ascontiguousarray(part).tobytes())
    return found.hexdigest()


def digest_elsewhere(robot, seed):
    """The same in a new process."""
    program = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_same_answers as t\n"
        "graph = t.stance_graph(robot=sys.argv[2])\n"
        "print(t.digest(graph, t.states_of(graph, int(sys.argv[3]))))"
    )
    folder = __file__.rpartition("/")[0]
    done = subprocess.run(
        [sys.executable, "-c", program, folder, robot, str(seed)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.strip()


@pytest.mark.parametrize("robot", ["mlivr3"])
def test_steps_do_not_depend_on_what_was_asked_before(robot):
    fresh = stance_graph(robot=robot)
    states = states_of(fresh, 3)
    expected = digest(fresh, states)
    backwards = stance_graph(robot=robot)
    digest(backwards, states[::-1])
    assert digest(backwards, states) == expected
    planned = stance_graph(robot=robot)
    goal = fresh.posture(states[1].stance).base_position[0]
    Planner(planned).plan(states[0], goal, "steps", goal_tolerance=0.05)
    assert digest(planned, states) == expected
    tabled = stance_graph(robot=robot)
    assert find_table(tabled) is not None
    assert digest(tabled, states) == expected
    assert digest_elsewhere(robot, 3) == expected


def test_a_step_that_was_planned_is_a_step():
    """Half a turn between bases at equal coordinates, where rounding decided the sense."""
    graph = stance_graph(robot="mlivr3")
    state = graph.state(("O3b:2", "O3b:7", "O4a:4"))
    before = graph.successors(state)
    after = graph.indices(("O3b:2", "O3b:1", "O4a:4"))
    goal = graph.posture(after).base_position[0]
    plan = Planner(graph).plan(state, goal, "steps", goal_tolerance=1e-4, time_limit=1e6).unwrap()
    assert len(plan.steps) == 1
    now = graph.successors(state)
    for one, other in zip(before, now, strict=True):
        np.testing.assert_array_equal(one, other)
    assert now.find(1, after[1]) >= 0


@pytest.mark.parametrize("robot", ["mlivr3"])
def test_what_rounding_leaves_decides_no_step(robot):
    """Bases moved by 1e-12 m, and turned by as much, allow the same steps."""
    graph, rng = stance_graph(robot=robot), np.random.default_rng(8)
    for _ in range(4):
        state = random_state(graph, rng)
        stances, postures = graph.neighbouring_nodes(state.stance)
        every, here = np.zeros(len(stances), dtype=np.int64), graph.posture(state.stance)
        answers = []
        for _ in range(2):
            found = graph.branch_sets_after([state], here, every, stances, postures)
            answers.append(found)
            for bases in (here, postures):
                for array in (bases.base_position, bases.base_rotation):
                    array += rng.uniform(-1e-12, 1e-12, array.shape)
        np.testing.assert_array_equal(*answers)
