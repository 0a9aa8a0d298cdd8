"""The unknown map: what is hidden, what looks and attempts reveal, and what they cost."""

import numpy as np
import pytest

from mlivr_gym.agents import (
    EvaluationTask,
    ExpertPolicy,
    RandomPolicy,
    evaluate,
    planner_policy,
)
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.layout_tasks import CLUSTER_RADIUS
from mlivr_gym.envs.tasks import WalkTasks
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.extensions.closed_loop import LookingPolicy
from mlivr_gym.extensions.closed_loop.unknown_map import PRIOR, UnknownMapEnv

pytestmark = pytest.mark.usefixtures("cache", "solved_once")

LOOK_RANGE, LOOK_COST = 0.6, 0.25


@pytest.fixture(scope="module")
def env(small_map, cache):
    return UnknownMapEnv(LOOK_RANGE, LOOK_COST, map=small_map, collisions=False)


@pytest.fixture(scope="module")
def known(small_map, cache):
    """The same tasks with the layouts known."""
    return MlivrEnv(map=small_map, collisions=False, tasks="clutter")


def around(env):
    """Return the points within the look range of the base, by Euclid."""
    base = np.array(env._info(False)["base_position"])
    apart = np.linalg.norm(env.graph.grasp_map.positions - base, axis=1)
    return set(np.flatnonzero(apart <= LOOK_RANGE).tolist())


def test_start_goal_and_layout_are_those_of_the_known_map_and_only_what_is_seen_is_told(env, known):
    hidden = 0
    for seed in range(8):
        observation, info = env.reset(seed=seed)
        _, told = known.reset(seed=seed)
        layout = known.graph.occupied
        assert (env.state, env.goal.tolist()) == (known.state, known.goal.tolist())
        assert info["fewest_steps"] == told["fewest_steps"]
        seen = around(env)
        assert set(np.flatnonzero(observation["unknown"] == 0).tolist()) == seen
        assert set(np.flatnonzero(observation["occupied"]).tolist()) == layout & seen
        assert env.graph.occupied == layout & seen
        hidden += len(layout - seen)
        prior = np.where(observation["unknown"] == 1, PRIOR, 0.0)
        np.testing.assert_array_equal(env.failure_probability, prior)
    assert hidden


def test_an_attempt_fails_where_the_layout_is_occupied_and_nowhere_else(env, known):
    fails = takes = 0
    for seed in range(12):
        env.reset(seed=seed)
        known.reset(seed=seed)
        layout = known.graph.occupied
        for _ in range(6):
            before, mask = env.state, env.action_masks()
            valid = np.flatnonzero(mask[:-1])
            point = valid % len(env.seen)
            unknown = valid[~env.seen[point]]
            action = int((unknown if len(unknown) else valid)[0])
            limb, point = divmod(action, len(env.seen))
            observation, reward, ended, _, info = env.step(action)
            assert reward == -1.0
            assert info["grasp_failed"] == (point in layout)
            assert observation["unknown"][point] == 0
            assert observation["occupied"][point] == (point in layout)
            if point in layout:
                fails += 1
                assert env.state.stance == before.stance
                assert not env.action_masks()[action]
            else:
                takes += 1
                assert env.state.stance == before.stance_after(limb, point)
            if ended:
                break
    assert fails
    assert takes


def test_a_look_reveals_what_is_in_range_and_it_lasts(env):
    look, revealed = env.action_space.n - 1, 0
    for seed in range(6):
        env.reset(seed=seed)
        steps, here = env.successors(), env._info(False)["base_position"]
        away = np.linalg.norm(steps.base_position - here, axis=1) * env.seen[steps.point]
        env.step(int(steps.limb[away.argmax()] * len(env.seen) + steps.point[away.argmax()]))
        before, steps = set(np.flatnonzero(env.seen).tolist()), env.steps
        observation, reward, _, _, info = env.step(look)
        assert reward == -LOOK_COST
        assert (info["looks"], info["steps"]) == (1, steps + 1)
        assert set(np.flatnonzero(observation["unknown"] == 0)) == before | around(env)
        revealed += len(around(env) - before)
        again = env.step(look)
        np.testing.assert_array_equal(again[0]["unknown"], observation["unknown"])
        assert env.action_masks()[look]
    assert revealed


def test_occupied_points_lie_in_clusters(small_map):
    """Each lies within the radius of a cluster, so its nearest neighbour is often occupied too."""
    env, random = (
        MlivrEnv(map=small_map, collisions=False, tasks=t) for t in ("clutter", "random")
    )
    shares = []
    for one in (env, random):
        alike = []
        for seed in range(20):
            one.reset(seed=seed)
            taken = np.zeros(len(small_map), dtype=bool)
            taken[list(one.graph.occupied)] = True
            apart = np.linalg.norm(small_map.positions[:, None] - small_map.positions, axis=2)
            np.fill_diagonal(apart, np.inf)
            assert apart.min() < CLUSTER_RADIUS
            alike.append(np.mean(taken[apart.argmin(axis=1)] == taken))
        shares.append(np.mean(alike))
    assert shares[0] > shares[1] + 0.1


def test_policies_that_know_what_the_robot_knows_arrive(env):
    for policy in (planner_policy(), ExpertPolicy()):
        for looks in (True, False):
            chosen = LookingPolicy(policy, looks)
            for task in range(2):
                observation, info = env.reset(options={"task": task})
                fewest = info["fewest_steps"]
                while not info["is_success"] and info["steps"] < 60:
                    action = chosen.act(env, observation, env.action_masks())
                    observation, _, _, _, info = env.step(action)
                    assert not info["invalid_action"]
                assert info["is_success"]
                assert info["steps"] - info["looks"] >= fewest
                assert looks or not info["looks"]


def test_a_robot_that_can_take_no_step_looks(env):
    """A failed attempt leaves the limbs on its branches, from which there may be no other step."""
    observation, _ = env.reset(seed=1)
    mask = np.zeros(env.action_space.n, dtype=bool)
    mask[-1] = True
    for policy in (RandomPolicy(), ExpertPolicy(), planner_policy()):
        assert LookingPolicy(policy).act(env, observation, mask) == len(mask) - 1
    for policy in (RandomPolicy(), ExpertPolicy()):
        policy.act(env, observation, mask[:-1])


def test_points_that_a_user_occupies_are_the_layout_of_the_next_episode(env):
    _, info = env.reset(seed=1)
    start, goal = info["stance"], env.goal.tolist()
    env.reset(seed=1, options={"start": start, "goal": goal})
    same = env.layout
    env.reset(seed=1)
    assert env.layout == same  # the layout of the episode before, not only what was seen of it
    told = env.graph.occupied
    with pytest.raises(MlivrError):
        env.reset(options={"goal": (1e3, 0.0, 0.0)})
    assert env.graph.occupied == told  # a reset that is refused tells nothing
    free = [p for p in range(len(env.seen)) if p not in env.state.stance]
    task = EvaluationTask(start, tuple(goal), env.graph.ids(free[:3]))
    found = evaluate(env, LookingPolicy(ExpertPolicy()), [task])
    assert env.layout == set(free[:3])
    assert found.success.all()


def test_what_the_environment_cannot_do_is_refused(small_map, env):
    given = {"map": small_map, "collisions": False}
    with pytest.raises(SettingError, match="tasks is WalkTasks"):
        UnknownMapEnv(tasks="walk", **given)
    with pytest.raises(SettingError, match="must be 'clutter', 'random' or LayoutTasks"):
        UnknownMapEnv(tasks=WalkTasks(), **given)
    for wrong in ({"grasp_failure": 0.1}, {"dynamics": "mujoco", "collisions": True}):
        with pytest.raises(SettingError, match="dynamics='kinematic' and grasp_failure=0"):
            UnknownMapEnv(**given | wrong)
    with pytest.raises(SettingError, match="look_cost"):
        UnknownMapEnv(look_cost=-1.0, **given)
    env.reset(seed=0)
    with pytest.raises(SettingError, match=str(env.action_space.n)):
        env.step(env.action_space.n)
    with pytest.raises(SettingError, match="UnknownMapEnv has another action"):
        evaluate(env, ExpertPolicy(), 1)
