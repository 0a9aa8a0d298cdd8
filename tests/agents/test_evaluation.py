"""Policies without training, and what counts as a success: the goal was reached, nothing else."""

import copy
import itertools
import math
from functools import partial
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

from mlivr_gym.agents import (
    EvaluationTask,
    ExpertPolicy,
    RandomPolicy,
    baseline_policy,
    evaluate,
    planner_policy,
)
from mlivr_gym.agents.evaluation import bootstrap
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.rewards import REWARDS
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.closed_loop.env import ClosedLoopEnv, ReplanningPolicy
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.parameters import Physics


class First:
    """The first action that is valid, or invalid."""

    def __init__(self, valid=True):
        self.valid = valid

    def act(self, env, observation, mask):
        return int(np.flatnonzero(mask == self.valid)[0])


@pytest.mark.parametrize("valid", [True, False])
def test_an_invalid_action_and_an_episode_that_is_cut_off_are_no_success(env, valid):
    """From starts that no single step joins with the goal."""
    planner, tasks, executed = Planner(env.graph), [], []
    for seed in range(40):
        env.reset(seed=seed)
        plan = planner.plan(env.state.stance, env.goal.tolist(), "steps").unwrap()
        if len(plan.steps) > 1:
            tasks.append(EvaluationTask(plan.stances[0], tuple(env.goal)))
    result = evaluate(env, First(valid), tasks, max_steps=1, execute=lambda *_: executed.append(1))
    assert len(tasks) > 10
    assert not result.success.any()
    assert (result.steps == 1).all()
    assert not executed
    assert ((result.base_translation > 0.0) == valid).all()
    assert np.isnan(result.executed).all()


def test_points_are_free_again_after_an_error(env):
    """The policy raises while the task occupies a point."""

    class Faulty:
        def act(self, env, observation, mask):
            assert env.graph.occupied == {7}
            raise ZeroDivisionError

    env.reset(seed=0)
    start, point = env.graph.ids(env.state.stance), env.graph.grasp_map.ids[7]
    goal = tuple(env.goal.tolist())
    assert point not in start
    with pytest.raises(ZeroDivisionError):
        evaluate(env, Faulty(), [EvaluationTask(start, goal, (point,))])
    assert not env.graph.occupied


def test_a_simulated_step_that_fails_is_no_success(small_map):
    """Grippers that must be on their points to a nanometre miss them, and the episode ends."""
    simulated = {"dynamics": "mujoco", "controller": "feedforward"}
    physics = Physics(capture_distance=1e-9)
    env = MlivrEnv(map=small_map, collisions=False, physics=physics, **simulated)
    executed = []
    result = evaluate(env, First(), 2, execute=lambda *given: executed.append(given))
    assert env._simulation_info["failure"]["kind"]
    assert result.success.tolist() == [False, False]
    assert result.success_rate == 0.0
    assert result.steps.tolist() == [1, 1]
    assert not executed


def test_tasks_are_evaluated_with_their_points_occupied(env):
    planner = Planner(env.graph)
    for seed in range(20):
        env.reset(seed=seed)
        start, goal = env.graph.ids(env.state.stance), env.goal
        plan = planner.plan(start, goal, "steps").unwrap()
        taken = plan.actions[0][1]
        env.graph.occupy([taken])
        other = planner.plan(start, goal, "steps").plan
        env.graph.vacate()
        if other is not None:
            break
    assert other is not None
    tasks = [EvaluationTask(start, tuple(goal)), EvaluationTask(start, tuple(goal), (taken,))]
    seen = []

    def execute(world, states):
        seen.append(states)
        return len(seen) == 1

    result = evaluate(env, planner_policy("steps"), tasks, execute=execute)
    assert result.success.all()
    assert result.executed.tolist() == [1.0, 0.0]
    assert env.graph.occupied == frozenset()
    assert result.steps.tolist() == [len(plan.steps), len(other.steps)]
    point = env.graph.grasp_map.index(taken)
    assert [env.graph.ids(state.stance) for state in seen[0]] == list(plan.stances)
    assert all(point not in state.stance for state in seen[1])


def test_what_is_counted_and_measured_is_that_of_the_episodes(small_map, monkeypatch):
    """By a clock that each look at it moves on by a second, and what the environment returned."""
    env = MlivrEnv(map=small_map, collisions=False, grasp_failure=0.45)
    looks, told, step, walks = itertools.count(), [], MlivrEnv.step, []
    clock = SimpleNamespace(perf_counter=lambda: float(next(looks)))
    monkeypatch.setattr("mlivr_gym.agents.evaluation.time", clock)

    def noted(world, action):
        found = step(world, action)
        told[-1].append(found[4])
        return found

    monkeypatch.setattr(MlivrEnv, "step", noted)
    reset = MlivrEnv.reset
    monkeypatch.setattr(MlivrEnv, "reset", lambda *a, **o: (told.append([]), reset(*a, **o))[1])
    result = evaluate(
        env, RandomPolicy(0), 6, execute=lambda world, states: bool(walks.append(states)) or True
    )
    counts = [len(infos) for infos in told]
    assert max(counts) > 1
    assert result.steps.tolist() == counts
    assert result.decision.tolist() == [float(count > 0) for count in counts]
    assert result.first_decision.tolist() == [2.0 * (count > 0) for count in counts]
    failed = [sum(bool(info["grasp_failed"]) for info in infos) for infos in told]
    assert max(failed) > 1
    assert result.failed_grasps.tolist() == failed
    metres = []
    for states in walks:
        places = env.graph.postures_of(states).base_position
        metres.append(sum(math.dist(*pair) for pair in itertools.pairwise(places.tolist())))
    assert result.base_translation[result.success] == pytest.approx(metres)
    assert result.success_rate == np.mean(result.success)


def test_bootstrap_interval_of_a_mean():
    """Against the normal approximation at 95 %, on average over many samples of 400 values."""
    rng, ends = np.random.default_rng(0), []
    for _ in range(30):
        values = rng.normal(5.0, 2.0, 400)
        ends.append((np.array(bootstrap(values)) - values.mean()) / (values.std() / 20.0))
    np.testing.assert_allclose(np.mean(ends, axis=0), [-1.96, 1.96], rtol=0.04)


def test_expert_policy_is_optimal_and_random_is_not(small_map):
    env = MlivrEnv(map=small_map, collisions=False)
    expert = evaluate(env, ExpertPolicy(), 20, seed=1)
    chance = evaluate(env, RandomPolicy(0), 20, seed=1, max_steps=30)
    assert expert.success_rate == 1.0
    assert chance.steps.mean() > expert.steps.mean()
    for k in range(20):
        env.reset(seed=1 + k)
        plan = Planner(env.graph).plan(env.state.stance, env.goal, "steps").unwrap()
        assert expert.steps[k] == len(plan.steps)
    with pytest.raises(SettingError, match="episodes is 0"):
        evaluate(env, RandomPolicy(), 0)
    with pytest.raises(SettingError, match="two limbs"):
        evaluate(MlivrEnv(robot="mlivr3", collisions=False), ExpertPolicy(), 1)


def test_what_an_expert_saw_before_is_of_no_matter(small_map):
    """It answers as a new one does, whatever changes between two questions."""
    env = MlivrEnv(map=small_map, collisions=False, grasp_failure=0.2)
    env.reset(seed=0)
    free = sorted(set(range(len(small_map))) - set(env.state.stance))
    kept, answers = {expects: ExpertPolicy(expects) for expects in (True, False)}, set()
    for change in (
        lambda: None,
        lambda: setattr(env, "goal", np.add(env.goal, (0.4, 0.0, 0.0))),
        lambda: setattr(env, "goal_tolerance", 0.4),
        lambda: setattr(env, "reward", env.reward._replace(step_reward=REWARDS["base"])),
        lambda: setattr(env, "failure_probability", np.full(len(small_map), 0.4)),
        lambda: env.graph.occupy(free[:3]),
        env.graph.vacate,
        lambda: env.reset(seed=1),
    ):
        change()
        for expects, policy in kept.items():
            told = policy.costs(env)
            np.testing.assert_array_equal(told, ExpertPolicy(expects).costs(env))
            answers.add((expects, told.tobytes()))
    assert len(answers) >= 10


@pytest.mark.parametrize("reward", ["steps", "base"])
def test_an_expert_acts_by_its_costs(small_map, reward):
    """Though it computes only those that it needs, and more of them after a grasp that failed."""
    env = MlivrEnv(map=small_map, collisions=False, reward=reward, grasp_failure=0.4)
    acting, counted = ExpertPolicy(), 0
    for seed in range(40):
        observation, _ = env.reset(seed=seed)
        ended = False
        while not ended:
            action = acting.act(env, observation, env.action_masks())
            costs = ExpertPolicy().costs(env)
            assert costs[action] == pytest.approx(costs.min(), abs=1e-7)
            observation, _, ended, _, info = env.step(action)
            counted += int(info["grasp_failed"])
    assert counted > 5


def test_policies_follow_walks_to_their_end(env):
    baselines = baseline_policy("two_level"), baseline_policy("mcts", budget=10)
    for policy in (*baselines, planner_policy("base")):
        assert evaluate(env, policy, 3, seed=1).success.all()


def test_planners_go_on_after_grasps_that_fail(small_map):
    """After a failed attempt the limb that held has fewer branches than a plan may count on."""
    env = MlivrEnv(map=small_map, grasp_failure=0.45)
    result = evaluate(env, planner_policy("steps"), 10, seed=26)
    assert result.success.all()
    assert result.failed_grasps.sum() > 5


def learned(env):
    return pytest.importorskip("mlivr_gym.agents.learned").load_policy("pretrained", env)


POLICIES = {
    "expert": lambda env: ExpertPolicy(),
    "planner": lambda env: planner_policy("base"),
    "local": lambda env: baseline_policy("local"),
    "learned": learned,
    "beam": lambda env: import_module("mlivr_gym.agents.learned").beam_policy(learned(env), 2),
    "replanning": lambda env: ReplanningPolicy("base"),
}
"""Policies that draw no numbers in their episodes."""


@pytest.mark.parametrize("way", [copy.copy, lambda one: one])
@pytest.mark.parametrize("name", POLICIES)
def test_a_policy_that_acted_in_another_world_acts_as_a_new_one(small_map, ladder, name, way):
    """On another map, and on the same one before points were taken."""
    new, make = POLICIES[name], MlivrEnv
    if name == "replanning":
        make = partial(ClosedLoopEnv, camera=None, boxes=0, plates=0)

    def acted(policy, env):
        observation, _ = env.reset(seed=4)
        chosen = []
        for _ in range(3):
            chosen.append(policy.act(env, observation, env.action_masks()))
            observation, *_ = env.step(chosen[-1])
        return chosen

    env = make(map=small_map)
    policy, plain = new(env), acted(new(env), env)
    for other in (make(map=ladder), env):
        acted(policy, other)
    other = way(policy)
    env.graph.occupy([small_map.ids[plain[0] % len(small_map)]])
    truth = acted(new(env), env)
    assert truth != plain
    assert acted(other, env) == truth


def test_a_plan_is_followed_until_goal_or_world_change(env):
    policy, plans = planner_policy("steps"), []
    planner = Planner(env.graph)
    for seed in range(99):
        observation, _ = env.reset(seed=seed)
        if len(planner.plan(env.state, env.goal, "steps").unwrap().steps) > 3:
            break
    for change in (None, None, "goal", "world"):
        if change == "goal":
            env.goal = env.goal + 0.01
        if change == "world":
            free = set(range(len(env.graph.grasp_map))) - set(env.state.stance)
            env.graph.occupy([max(free)])
        observation, *_ = env.step(policy.act(env, observation, env.action_masks()))
        plans.append(policy.plans)
    env.graph.vacate()
    assert plans == [1, 1, 2, 3]
