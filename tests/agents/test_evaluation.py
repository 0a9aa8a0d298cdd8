"""What counts as a success: the goal was reached, and nothing else."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from mlivr_gym.agents import EvaluationTask, ExpertPolicy, RandomPolicy, evaluate
from mlivr_gym.agents.evaluation import bootstrap
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.parameters import Physics


class First:
    """The first action that is valid, or invalid."""

    def __init__(self, valid=True):
        self.valid = valid

    def act(self, env, observation, mask):
        return int(np.flatnonzero(mask == self.valid)[0])


def test_an_episode_that_is_cut_off_is_no_success(env):
    """From starts that no single step joins with the goal."""
    planner, tasks = Planner(env.graph), []
    for seed in range(40):
        env.reset(seed=seed)
        plan = planner.plan(env.state.stance, env.goal.tolist(), "steps").unwrap()
        if len(plan.steps) > 1:
            tasks.append(EvaluationTask(plan.stances[0], tuple(env.goal)))
    result = evaluate(env, RandomPolicy(0), tasks, max_steps=1)
    assert len(tasks) > 10
    assert not result.success.any()
    assert (result.steps == 1).all()


def test_an_invalid_action_is_no_success(env):
    executed = []
    result = evaluate(env, First(valid=False), 5, execute=lambda *given: executed.append(given))
    assert not result.success.any()
    assert (result.steps == 1).all()
    assert not executed
    assert (result.base_translation == 0.0).all()
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


def test_reaching_the_goal_is_a_success_and_the_walk_is_told(env):
    walks = []
    env.reset(seed=1)
    plan = Planner(env.graph).plan(env.state.stance, env.goal.tolist(), "steps").unwrap()

    class Follow:
        def act(self, env, observation, mask):
            limb, point = plan.actions[env.steps]
            return limb * len(env.graph.grasp_map) + env.graph.grasp_map.index(point)

    tasks = [EvaluationTask(plan.stances[0], plan.query.goal)]
    result = evaluate(env, Follow(), tasks, execute=lambda env, states: walks.append(states))
    assert result.success.all()
    assert result.steps.tolist() == [len(plan.steps)]
    assert [env.graph.ids(state.stance) for state in walks[0]] == list(plan.stances)


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
    result = evaluate(
        env,
        ExpertPolicy(),
        tasks,
        execute=lambda world, states: bool(seen.append(states) or len(seen) == 1),
    )
    assert result.success.all()
    assert result.executed.tolist() == [1.0, 0.0]
    assert env.graph.occupied == frozenset()
    assert result.steps.tolist() == [len(plan.steps), len(other.steps)]
    point = env.graph.grasp_map.index(taken)
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
