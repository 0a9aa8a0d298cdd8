"""Random layouts: occupied points, start and goal by seed, joined by a plan that is optimal."""

import numpy as np
import pytest
from state_graph import least_cost, reachable, within

from mlivr_gym.agents import ExpertPolicy
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.layout_tasks import OCCUPIED_SHARES

pytestmark = pytest.mark.usefixtures("cache")


@pytest.fixture(scope="module")
def env(small_map, cache):
    return MlivrEnv(map=small_map, collisions=False, tasks="random")


def drawn(env):
    return env.graph.occupied, env.state, env.goal.tolist()


def test_a_seed_gives_one_layout_start_and_goal(small_map, env):
    other = MlivrEnv(map=small_map, collisions=False, tasks="random")
    other.reset(seed=99)
    seen = set()
    for seed in range(8):
        for one in (env, other):
            one.reset(seed=seed)
        assert drawn(env) == drawn(other)
        seen.add(env.graph.occupied)
        share = len(env.graph.occupied) / len(small_map)
        assert OCCUPIED_SHARES[0] - 0.02 <= share <= OCCUPIED_SHARES[1] + 0.02
    assert len(seen) == 8
    env.reset(options={"task": 3})
    other.reset(options={"task": 3})
    assert drawn(env) == drawn(other)
    assert env.graph.occupied not in seen


def test_observation_and_mask_follow_the_layout(small_map, env):
    points = len(small_map)
    for seed in range(8):
        observation, info = env.reset(seed=seed)
        assert observation in env.observation_space
        taken = np.flatnonzero(observation["occupied"])
        assert set(taken.tolist()) == env.graph.occupied
        assert not set(env.state.stance) & env.graph.occupied
        for _ in range(4):
            mask = info["action_mask"].reshape(2, points)
            assert mask.any()
            assert not mask[:, taken].any()
            action = int(np.flatnonzero(mask.ravel())[-1])
            observation, _, ended, _, info = env.step(action)
            assert not info["invalid_action"]
            if ended:
                break
        invalid = env.step(int(taken[0]))[4]
        assert invalid["invalid_action"]


def test_the_fewest_steps_are_those_of_networkx_and_the_expert_takes_them(small_map):
    half = small_map.subset(np.arange(len(small_map)) % 2 == 0, "half")
    env = MlivrEnv(map=half, collisions=False, tasks="random")
    for seed in range(2):
        observation, info = env.reset(seed=seed)
        fewest = info["fewest_steps"]
        net = reachable(env.graph, env.state)
        ends = within(net, env.goal, env.goal_tolerance)
        assert fewest == least_cost(net, env.state, ends) > 0
        expert = ExpertPolicy()
        while not info["is_success"]:
            action = expert.act(env, observation, env.action_masks())
            observation, _, _, _, info = env.step(action)
            assert info["fewest_steps"] == fewest
        assert info["steps"] == fewest


def test_a_start_that_is_given_stays_free_and_a_layout_stays_if_nothing_is_drawn(env):
    env.reset(seed=5)
    state = env.state
    for seed in range(5):
        env.reset(seed=100 + seed)  # whose layout may have taken these points
        _, info = env.reset(seed=seed, options={"start": state.stance})
        assert env.state == state
        assert info["fewest_steps"] > 0
    occupied, goal = env.graph.occupied, env.goal
    env.reset(seed=77, options={"start": state.stance, "goal": goal})
    assert env.graph.occupied == occupied
    here = env.graph.posture_of(state).base_position[0]
    assert env.reset(options={"start": state.stance, "goal": here})[1]["fewest_steps"] == 0
    free = {*state.stance, int(env.graph.successors(state).point[0])}
    env.graph.occupy([p for p in range(len(env.graph.grasp_map)) if p not in free])
    _, info = env.reset(options={"start": state.stance, "goal": env.graph.grasp_map.cabin[0]})
    assert info["fewest_steps"] == -1
