import importlib
import sys
from functools import cache

import numpy as np
import pytest

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError
from mlivr_gym.simulation.dynamics import dynamics_spec

pytest.importorskip("dm_control")

from absl.testing import absltest
from dm_env import test_utils

from mlivr_gym.envs.dm_env import MlivrDmEnvironment
from mlivr_gym.planners import Planner


@cache
def env():
    return MlivrEnv(collisions=False)


@pytest.fixture(scope="module", autouse=True)
def env_goes_with_this_file():
    yield
    env.cache_clear()


class TestInterface(test_utils.EnvironmentTestMixin, absltest.TestCase):
    """The tests of dm_env, with an episode that reaches its end."""

    def make_object_under_test(self):
        return MlivrDmEnvironment(env(), seed=0, max_episode_steps=8)

    def make_action_sequence(self):
        rng = np.random.default_rng(0)
        for _ in range(20):
            mask = self.environment.env.action_masks()
            yield self.environment.action_spec().dtype.type(rng.choice(np.flatnonzero(mask)))


def test_the_mask_is_observed_and_the_discount_tells_goal_from_step_limit():
    environment = MlivrDmEnvironment(env(), seed=3)
    timestep, graph = environment.reset(), env().graph
    goal = environment.env.goal.tolist()
    plan = Planner(graph).plan(environment.info["stance"], goal, "steps").unwrap()
    for limb, point in plan.actions:
        assert np.array_equal(timestep.observation["action_mask"], environment.env.action_masks())
        timestep = environment.step(limb * len(graph.grasp_map) + graph.grasp_map.index(point))
    assert timestep.last()
    assert environment.info["is_success"]
    assert timestep.discount == 0.0
    short = MlivrDmEnvironment(env(), seed=3, max_episode_steps=1)
    timestep = short.reset()
    mask = timestep.observation["action_mask"]
    timestep = short.step(int(np.flatnonzero(mask == 0)[0]))
    assert timestep.last()
    assert timestep.discount == 1.0
    short.reset()
    with pytest.raises(SettingError, match=r"action 2\.7"):
        short.step(2.7)


@pytest.mark.parametrize("limbs", [2, 3])
def test_the_exported_model_loads_and_steps_in_dm_control(jem, limbs):
    from dm_control.mujoco import Physics

    from mlivr_gym import robot_spec

    spec = dynamics_spec(jem, robot_spec(f"mlivr{limbs}"))
    model = spec.compile()
    physics = Physics.from_xml_string(spec.to_xml())
    assert (physics.model.nv, physics.model.nu) == (model.nv, model.nu)
    assert physics.model.ngeom == model.ngeom
    physics.data.qpos[0] = 4.0
    for _ in range(10):
        physics.step()
    assert np.isfinite(physics.data.qpos).all()


def test_without_the_extra_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "dm_env", None)
    monkeypatch.delitem(sys.modules, "mlivr_gym.envs.dm_env")
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'mlivr-gym\[dm\]'"):
        importlib.import_module("mlivr_gym.envs.dm_env")
