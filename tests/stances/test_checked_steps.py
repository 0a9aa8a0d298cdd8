"""Steps checked many at once, from several states, are those checked one by one."""

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.world.boxes import Box


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
        start = random_state(graph, rng)
        walk = [start]
        for _ in range(4):
            steps = graph.successors(walk[-1])
            walk.append(steps.after(walk[-1], int(rng.integers(len(steps.limb)))))
        stances = [state.stance for state in walk[1:]]
        boxes = ()
        if half:
            where = graph.posture_of(walk[2]).base_position[0] + rng.uniform(-0.3, 0.3, 3)
            boxes = (Box("box", "obstacle", tuple(where.tolist()), (half,) * 3),)
        for one in (graph, again):
            one.remove_obstacles()
            one.add_obstacles(boxes)
        for chosen in (stances, [*stances[:2], stances[1], *stances[2:]], stances[::2]):
            expected = in_turn(graph, start, chosen)
            assert again.states_along(start, chosen) == expected
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
