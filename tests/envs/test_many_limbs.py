"""The environments of three and four limbs."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env


@pytest.mark.parametrize("limbs", [3, 4])
def test_the_registered_environments_have_as_many_limbs_as_their_names_say(small_map, limbs):
    made = gymnasium.make(f"MLIVR{limbs}-JEM-v0", map=small_map, collisions=False)
    env = made.unwrapped
    assert env.graph.robot.name == f"mlivr{limbs}"
    check_env(env, skip_render_check=True)
    _, info = made.reset(seed=0)
    for _ in range(4):
        before = env.state
        action = made.action_space.sample(info["action_mask"])
        limb, point = divmod(int(action), len(small_map))
        observation, reward, *_, info = made.step(action)
        assert reward == -1.0
        np.testing.assert_array_equal(observation["stance"], before.stance_after(limb, point))
        # What the mask allows is what the graph says of every action, one by one.
        for other in np.random.default_rng(action).integers(limbs * len(small_map), size=30):
            after = env.state.stance_after(*divmod(int(other), len(small_map)))
            possible = len(set(after)) == limbs and env.graph.step_to(env.state, after) is not None
            assert info["action_mask"][other] == possible


def test_copies_of_four_limbs_step_one_after_the_other(small_map):
    copies = gymnasium.make_vec(
        "MLIVR4-JEM-v0", num_envs=2, map=small_map, collisions=False, vectorization_mode="sync"
    )
    observation, info = copies.reset(seed=1)
    assert observation["stance"].shape == (2, 4)
    actions = [int(np.flatnonzero(mask)[0]) for mask in info["action_mask"]]
    assert copies.step(np.array(actions))[0]["stance"].shape == (2, 4)
