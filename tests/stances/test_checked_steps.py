"""Steps checked many at once, from several states, are those checked one by one."""

import numpy as np
import pytest

from mlivr_gym import stance_graph
from mlivr_gym.stances.random_states import random_state


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3"])
def test_steps_of_several_states_are_those_of_each(small_map, robot):
    graph, again = (stance_graph(small_map, robot) for _ in range(2))
    rng = np.random.default_rng(2)
    states = [random_state(graph, rng) for _ in range(3)]
    # After a step the limbs that hold are on fewer branches.
    steps = graph.successors(states[0])
    states.append(steps.after(states[0], 0))
    before, rows = [], []
    for k, state in enumerate(states):
        nodes, _ = graph.neighbouring_nodes(state.stance)
        chosen = rng.permutation(len(nodes))[:12]
        before += [k] * len(chosen)
        rows += nodes[chosen].tolist()
    mixed = rng.permutation(len(rows))
    before, rows = np.array(before)[mixed], np.array(rows)[mixed]
    here, after = graph.postures_of(states), graph.postures(rows)
    branch_sets = graph.branch_sets_after(states, here, before, rows, after)
    possible = 0
    for k, stance, found in zip(before.tolist(), rows.tolist(), branch_sets.tolist(), strict=True):
        one = again.step_to(states[k], tuple(stance))
        assert (one is None) == (not all(found))
        if one is not None:
            assert one.branch_sets == tuple(found)
            possible += 1
    assert 5 < possible < len(rows)
