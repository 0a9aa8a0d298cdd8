"""The environments that are registered: the checkers, the JSON of their specs, and their masks."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

from mlivr_gym.envs import AnywhereTasks
from mlivr_gym.envs.layout_tasks import LayoutTasks
from mlivr_gym.robot.cargo import Cargo

ENVIRONMENTS = {
    "MLIVR-JEM-v0": lambda env: env.graph.robot.name == "mlivr2",
    "MLIVR-JEM-Far-v0": lambda env: env.tasks.far,
    "MLIVR-JEM-Cargo-v0": lambda env: (
        env.tasks.far and env.graph.robot.cargo == Cargo(30.0, (0.4, 0.4, 0.3))
    ),
    "MLIVR-Random-v0": lambda env: env.tasks == LayoutTasks(),
    "MLIVR-JEM-Unknown-v0": lambda env: env.tasks == LayoutTasks(clustered=True),
    "MLIVR-JEM-ClosedLoop-v0": lambda env: env.boxes == 5 and env.plates == 10,
    "MLIVR3-JEM-v0": lambda env: env.graph.robot.name == "mlivr3",
    "MLIVR4-JEM-v0": lambda env: env.graph.robot.name == "mlivr4",
    "MLIVR4-JEM-Anywhere-v0": lambda env: (
        env.graph.robot.name == "mlivr4" and env.tasks == AnywhereTasks()
    ),
    "MLIVR-Unseen-v0": lambda env: env.tasks == AnywhereTasks(),
}
"""Names, and what they promise."""


PLACES = ("USLab", "Columbus", "Hatch", "Station", "Truss")
"""The same environment in other places; `test_places.py` looks at it there."""


def test_every_environment_that_is_registered_is_checked():
    found = {name for name in gymnasium.registry if name.startswith("MLIVR")}
    assert found == ENVIRONMENTS.keys() | {f"MLIVR-{place}-v0" for place in PLACES}


def arguments(small_map, name=""):
    if "Unseen" in name:
        worlds = [("mlivr2", small_map)]
        return {"training": worlds, "held_out": worlds, "collisions": False}
    if "ClosedLoop" in name:
        return {"map": small_map, "camera": {"pixels": 10, "period": 2.0}}
    return {"map": small_map, "collisions": False}


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_a_registered_environment_is_sound_and_made_again_from_json(small_map, name):
    made = gymnasium.make(name, **arguments(small_map, name))
    assert ENVIRONMENTS[name](made.unwrapped)
    check_env(made.unwrapped, skip_render_check=True)
    check_env_of_sb3(made.unwrapped)
    again = gymnasium.make(EnvSpec.from_json(made.spec.to_json()))
    assert again.unwrapped.tasks == made.unwrapped.tasks
    assert data_equivalence(made.reset(seed=5), again.reset(seed=5))


@pytest.mark.parametrize("limbs", [3, 4])
def test_a_mask_allows_what_the_graph_says_of_every_action(small_map, limbs):
    made = gymnasium.make(f"MLIVR{limbs}-JEM-v0", **arguments(small_map))
    env = made.unwrapped
    _, info = made.reset(seed=0)
    for _ in range(4):
        before = env.state
        action = made.action_space.sample(info["action_mask"])
        limb, point = divmod(int(action), len(small_map))
        observation, reward, *_, info = made.step(action)
        assert reward == -1.0
        np.testing.assert_array_equal(observation["stance"], before.stance_after(limb, point))
        for other in np.random.default_rng(action).integers(limbs * len(small_map), size=30):
            after = env.state.stance_after(*divmod(int(other), len(small_map)))
            possible = len(set(after)) == limbs and env.graph.step_to(env.state, after) is not None
            assert info["action_mask"][other] == possible


@pytest.mark.parametrize("name", ["MLIVR-Random-v0", "MLIVR4-JEM-v0"])
def test_copies_without_a_table_in_common_step_one_after_the_other(small_map, name):
    copies = gymnasium.make_vec(name, num_envs=2, vectorization_mode="sync", **arguments(small_map))
    observation, info = copies.reset(seed=3)
    assert any((first != second).any() for first, second in observation.values())
    actions = [int(np.flatnonzero(mask)[0]) for mask in info["action_mask"]]
    after = copies.step(np.array(actions))[0]["stance"]
    assert after.shape == observation["stance"].shape
    assert ((after != observation["stance"]).sum(axis=1) == 1).all()
