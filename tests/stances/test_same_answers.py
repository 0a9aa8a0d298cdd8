"""Steps are the same whatever was asked before, one by one or many at once, and where."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
import random_steps
from processes import printed
from random_steps import random_walk

from mlivr_gym import stance_graph
from mlivr_gym.planners import Planner
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.stances.table_build import find_table
from mlivr_gym.world.boxes import Box

WALKS, STEPS = 2, 3


def states_of(graph, seed):
    """States of random walks: those that a robot takes hold in, and what is left of them later."""
    rng = np.random.default_rng(seed)
    return [state for _ in range(WALKS) for state in random_walk(graph, rng, STEPS)]


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
        "import sys; sys.path[:0] = sys.argv[1:3]; import test_same_answers as t\n"
        "graph = t.stance_graph(robot=sys.argv[3])\n"
        "print(t.digest(graph, t.states_of(graph, int(sys.argv[4]))))"
    )
    folders = Path(__file__).parent, Path(random_steps.__file__).parent
    (line,) = printed("-c", program, *folders, robot, seed)
    return line


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


def in_turn(graph, state, stances):
    """States after steps to stances, found among all steps that leave each state."""
    states = [state]
    for stance in stances:
        steps = graph.successors(states[-1])
        after = [steps.after(states[-1], k) for k in range(len(steps.limb))]
        found = [one for one in after if one.stance == stance]
        if not found:
            break
        states += found
    return tuple(states)


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
@pytest.mark.parametrize("half", [0.0, 0.1], ids=["empty", "box"])
def test_states_along_stances_are_those_after_each_step_in_turn(small_map, robot, half):
    graph, again = (stance_graph(small_map, robot) for _ in range(2))
    rng, lengths = np.random.default_rng(3), set()
    for _ in range(10):
        walk = random_walk(graph, rng, 4)
        stances = [state.stance for state in walk[1:]]
        boxes = ()
        if half:
            where = graph.posture_of(walk[2]).base_position[0] + rng.uniform(-0.3, 0.3, 3)
            boxes = (Box("box", "obstacle", tuple(where.tolist()), (half,) * 3),)
        for one in (graph, again):
            one.remove_obstacles()
            one.add_obstacles(boxes)
        for chosen in (stances, [*stances[:2], stances[1], *stances[2:]], stances[::2]):
            expected = in_turn(graph, walk[0], chosen)
            assert again.states_along(walk[0], chosen) == expected
            lengths.add(len(expected))
    assert len(lengths) > 2


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
def test_releases_and_postures_are_those_of_a_graph_without_a_past(small_map, robot):
    """Also among obstacles that came one by one, and with a point that was occupied in between."""
    graph, rng = stance_graph(small_map, robot), np.random.default_rng(8)
    stances = np.array([random_state(graph, rng).stance for _ in range(12)])
    centre = graph.postures(stances).base_position.mean(axis=0)
    boxes = [
        Box(f"b{k}", "obstacle", tuple(centre + rng.uniform(-0.5, 0.5, 3)), (0.1, 0.1, 0.1))
        for k in range(3)
    ]
    every = []
    for present in (boxes[:1], boxes[:2], boxes, boxes[1:2]):
        if len(present) == 1:
            graph.remove_obstacles()
        graph.add_obstacles(present[-1:])
        graph.occupy([int(stances[0, 0])])
        graph.postures(stances)
        graph.vacate()
        fresh = stance_graph(small_map, robot)
        fresh.add_obstacles(present)
        postures = graph.postures(stances)
        for name in ("base_position", "base_rotation", "branch_sets", "w_m"):
            expected = getattr(fresh.postures(stances), name)
            np.testing.assert_array_equal(getattr(postures, name), expected)
        nodes = graph.is_node(postures)
        releases = graph.all_releases(stances[nodes], postures.take(nodes))
        expected = fresh.all_releases(stances[nodes], postures.take(nodes))
        for name in ("branches", "folds"):
            np.testing.assert_array_equal(releases[name], expected[name])
        every.append(postures.branch_sets.tolist())
    assert len({str(one) for one in every}) > 1
