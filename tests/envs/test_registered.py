"""Registered environments: the checkers, their actions and masks, the JSON of what made them."""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence
from sb3_contrib.common.maskable.utils import get_action_masks
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

from mlivr_gym import Limb, RobotSpec
from mlivr_gym.envs import AnywhereTasks
from mlivr_gym.envs.layout_tasks import LayoutTasks
from mlivr_gym.envs.rewards import REWARDS
from mlivr_gym.envs.wrappers import ActionMaskObservation
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.plan_checks import check_motion
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.planners.costs import Cost
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.robot.dh_table import frames_of_dh, ur_dh
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.parameters import Limits, Physics
from mlivr_gym.simulation.setup import Setup

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

"""The same environment in other places, see `test_a_walk_in_the_place`."""


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
    made.action_space.seed(0)
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


def remade(env):
    """The environment that the JSON of its spec makes."""
    return gymnasium.make(EnvSpec.from_json(env.spec.to_json()))


def test_an_environment_of_objects_is_made_again_from_json(small_map):
    given = {"limb": Limb(*frames_of_dh(ur_dh(a2=-0.43))), "body_mass": np.float64(21.0)}
    robot = RobotSpec(name="own", heights=(0.62, 0.7), dynamics="ur5e", **given)
    physics, limits = Physics(hold_force=120.0), Limits(torque=0.5)
    env = gymnasium.make(
        "MLIVR-JEM-v0", map=small_map, robot=robot, physics=physics, limits=limits,
        dynamics="mujoco", collisions=np.bool_(False), clearance=np.float64(0.025),
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
    given = {"map": Path(file), "collisions": False, "grasp_failure": risk}
    env = ActionMaskObservation(gymnasium.make("MLIVR-JEM-v0", 7, **given))
    again = remade(env)
    np.testing.assert_array_equal(again.unwrapped.failure_probability, risk)
    assert again.unwrapped.graph.grasp_map.fingerprint == ladder.fingerprint
    assert isinstance(again, ActionMaskObservation)
    assert again.spec.max_episode_steps == 7


SHORT = 2
"""Most steps of a walk that is carried out."""


def short_plan(env):
    """Return a plan of few steps, for the first fixed task that has one, and the mask there."""
    for task in range(30):
        observation, info = env.reset(options={"task": task})
        assert observation in env.observation_space
        assert info["action_mask"].any()
        query = {"goal_tolerance": env.goal_tolerance, "options": SearchOptions(limit=2000)}
        plan = Planner(env.graph).plan(env.state, env.goal, **query).plan
        if plan is not None and 1 <= len(plan.steps) <= SHORT:
            return plan, info["action_mask"]
    raise AssertionError("none of the first tasks is near")


@pytest.mark.parametrize("name", ["Hatch", "Truss"])
def test_a_walk_in_the_place_is_planned_checked_and_carried_out_in_mujoco(name):
    place = gymnasium.make(f"MLIVR-{name}-v0").unwrapped
    (plan, mask), graph = short_plan(place), place.graph
    assert graph.grasp_map.name == name.lower()
    check_motion(plan.query, plan.world, plan.motion, graph.grasp_map)
    limb, point = plan.actions[0]
    action = limb * len(graph.grasp_map) + graph.grasp_map.index(point)
    assert mask[action]
    assert place.step(action)[0] in place.observation_space
    kind = "station" if name == "Truss" else None
    setup = Setup.of(kind, kind, kind)
    simulation = setup.simulation(graph.grasp_map, graph.robot)
    walk = execute(graph, plan, setup.timing, simulation=simulation)
    assert walk.failure is None
    assert len(walk.captures) == len(plan.steps)
    away = np.linalg.norm(plan.motion.base_positions[-1] - place.goal)
    assert away <= place.goal_tolerance + 1e-9


@pytest.fixture(scope="module")
def small_env(small_map):
    return gymnasium.make("MLIVR-JEM-v0", map=small_map, collisions=False, max_episode_steps=5)


@pytest.mark.parametrize(
    "form", [int, np.uint16, np.array, torch.tensor, lambda a: np.array(a, np.int16)]
)
def test_one_step_whatever_the_form_of_the_action(small_env, form):
    _, info = small_env.reset(seed=0)
    number = int(np.flatnonzero(info["action_mask"])[0])
    expected = small_env.step(number)
    small_env.reset(seed=0)
    action = form(number)
    assert torch.is_tensor(action) or small_env.action_space.contains(action)
    observation, *_, info = small_env.unwrapped.step(action)
    assert not info["invalid_action"]
    np.testing.assert_array_equal(observation["stance"], expected[0]["stance"])


def test_what_the_action_space_does_not_contain_is_refused(small_env):
    small_env.reset(seed=0)
    before = small_env.unwrapped.steps
    for action in (3.0, np.array([3]), torch.tensor(3.0), "3", -1, 76, np.uint64(2**63), np.True_):
        with pytest.raises(SettingError, match=r"action .* is not a whole number from 0 to"):
            small_env.unwrapped.step(action)
    assert small_env.unwrapped.steps == before


def test_the_mask_is_observed_where_it_is_asked_for(small_env):
    world = ActionMaskObservation(small_env)
    observation, info = world.reset(seed=0)
    for _ in range(3):
        assert world.observation_space.contains(observation)
        np.testing.assert_array_equal(observation["action_mask"], get_action_masks(world))
        np.testing.assert_array_equal(observation["action_mask"], info["action_mask"])
        observation, *_, info = world.step(int(np.flatnonzero(info["action_mask"])[0]))
