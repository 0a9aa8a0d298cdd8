"""What made an environment survives JSON, whatever it was made of."""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from mlivr_gym import Limb, RobotSpec
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.plain_spec import plain_value
from mlivr_gym.envs.rewards import REWARDS
from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.planners.costs import Cost
from mlivr_gym.robot.dh_table import frames_of_dh, ur_dh
from mlivr_gym.simulation.parameters import Limits, Physics


def remade(env):
    """The environment that the JSON of its spec makes."""
    return gymnasium.make(EnvSpec.from_json(env.spec.to_json()))


def test_an_environment_of_objects_is_made_again_from_json(small_map):
    robot = RobotSpec(
        name="own",
        heights=(0.62, 0.7),
        limb=Limb(*frames_of_dh(ur_dh(a2=-0.43))),
        body_mass=np.float64(21.0),
        dynamics="ur5e",
    )
    physics, limits = Physics(hold_force=120.0), Limits(torque=0.5)
    env = gymnasium.make(
        "MLIVR-JEM-v0", map=small_map, robot=robot, physics=physics, limits=limits,
        dynamics="mujoco",
        collisions=np.bool_(False),
        clearance=np.float64(0.025),
    )  # fmt: skip
    again = remade(env)
    ours, theirs = env.unwrapped, again.unwrapped
    for name in ("positions", "rotations", "cabin"):
        np.testing.assert_array_equal(
            getattr(theirs.graph.grasp_map, name), getattr(small_map, name)
        )
    for name in ("ids", "faces", "name", "segments", "handrails", "boxes", "fingerprint"):
        assert getattr(theirs.graph.grasp_map, name) == getattr(small_map, name)
    assert theirs.graph.robot == robot
    assert theirs.graph.robot.fingerprint == robot.fingerprint
    assert theirs.graph.settings == ours.graph.settings
    assert (theirs._executor.setup.physics, theirs._executor.setup.timing) == (physics, limits)
    assert again.spec == env.spec
    assert type(env.spec.kwargs["map"]) is dict
    np.testing.assert_array_equal(theirs.graph.base_position, ours.graph.base_position)
    assert again.reset(seed=4)[1]["stance"] == env.reset(seed=4)[1]["stance"]


@pytest.mark.parametrize(
    ("name", "given"),
    [("reward", REWARDS["base"]), ("reward", Cost.custom(1.0, 0.5)), ("tasks", {"kind": "far"})],
)
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_json_keeps_rewards_and_tasks(small_map, make, name, given):
    made = make("MLIVR-JEM-v0", map=small_map, collisions=False, **{name: given})
    again = make(EnvSpec.from_json(made.spec.to_json()))
    ours, theirs = (getattr(one.unwrapped, "env", one.unwrapped) for one in (made, again))
    assert getattr(ours, name) == getattr(theirs, name)
    assert again.spec == made.spec


def test_failure_probabilities_paths_and_wrappers_survive(ladder, tmp_path):
    risk = np.linspace(0.0, 0.3, len(ladder))
    file = tmp_path / "map.json"
    file.write_text(json.dumps(ladder.to_dict()))
    env = ActionMaskObservation(
        gymnasium.make(
            "MLIVR-JEM-v0",
            map=Path(file),
            collisions=False,
            grasp_failure=risk,
            max_episode_steps=7,
        )
    )
    again = remade(env)
    np.testing.assert_array_equal(again.unwrapped.failure_probability, risk)
    assert again.unwrapped.graph.grasp_map.fingerprint == ladder.fingerprint
    assert isinstance(again, ActionMaskObservation)
    assert again.spec.max_episode_steps == 7


def test_the_spec_does_not_change_with_its_environment(ladder):
    """The arguments that a caller keeps stay as they are."""
    arguments = {"map": ladder, "collisions": False}
    env = gymnasium.make("MLIVR-JEM-v0", **arguments)
    assert arguments["map"] is ladder
    assert env.unwrapped.spec.kwargs["map"] == plain_value(ladder.to_dict())
    assert MlivrEnv(**arguments).spec is None
