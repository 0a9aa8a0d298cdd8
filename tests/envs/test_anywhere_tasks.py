"""Tasks anywhere: a plan joins start and goal, with two limbs and with four."""

import numpy as np
import pytest

from mlivr_gym.envs import AnywhereTasks, MlivrEnv

pytestmark = pytest.mark.usefixtures("cache")


def test_a_goal_can_be_reached_from_its_start_but_does_not_lie_there(jem):
    """A search by hand over the steps of the graph, breadth first, finds each goal.

    No step leads from one part of the map to the other.
    """
    x = jem.positions[:, 0]
    parted = jem.subset(((x < 1.8) | (x > 6.4)) & np.isin(jem.faces, ["deck"]), "parted")
    env = MlivrEnv(map=parted, collisions=False, tasks="anywhere")
    graph, (low, high) = env.graph, parted.cabin
    away = []
    for seed in range(12):
        _, info = env.reset(seed=seed)
        away.append(np.linalg.norm(info["base_position"] - env.goal))
        assert ((low <= env.goal) & (env.goal <= high)).all()
        front, seen, reached = [env.state], {env.state}, False
        while front and not reached:
            after = []
            for state in front:
                steps = graph.successors(state)
                there = np.linalg.norm(steps.base_position - env.goal, axis=1)
                reached |= bool((there <= env.goal_tolerance).any())
                after += [
                    one for k in range(len(there)) if (one := steps.after(state, k)) not in seen
                ]
                seen.update(after)
            front = list(dict.fromkeys(after))
        assert reached
    assert min(away) > env.goal_tolerance


def test_four_limbs_get_tasks_that_are_the_same_whenever_they_are_drawn(small_map):
    env = MlivrEnv("mlivr4", small_map, collisions=False, tasks="anywhere")
    env.reset(options={"task": 3})
    start, goal = env.state, env.goal
    env.reset(seed=1)
    env.reset(options={"task": 3})
    assert env.state == start
    np.testing.assert_array_equal(env.goal, goal)
    assert MlivrEnv(map=small_map, tasks=AnywhereTasks().to_dict()).tasks == AnywhereTasks()
