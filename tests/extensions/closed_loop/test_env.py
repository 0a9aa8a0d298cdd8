"""The environment of the closed loop: what is sensed, what attempts cost, and how it ends."""

import gymnasium
import numpy as np
import pytest
from loop_walks import GOAL, START

from mlivr_gym import Box, MlivrError
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError
from mlivr_gym.extensions.closed_loop.belief import CELL, GRID_BORDER, Belief
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.env import ClosedLoopEnv, ReplanningPolicy
from mlivr_gym.extensions.closed_loop.hits import CUBE
from mlivr_gym.extensions.closed_loop.sensing_robot import ATTEMPTS
from mlivr_gym.extensions.closed_loop.things import unknown_things
from mlivr_gym.planners import Planner
from mlivr_gym.simulation.step_executor import MEASURES

TASK = {"start": START, "goal": GOAL}


@pytest.fixture(scope="module")
def env():
    return ClosedLoopEnv(camera={"period": 0.5, "pixels": 40})


@pytest.fixture(scope="module")
def empty():
    """An environment without unknown things."""
    return ClosedLoopEnv(0, 0, camera=None)


def first_action(env):
    return ReplanningPolicy().act(env, env._observation(), env.action_masks())


def held(env):
    """The points that the simulated robot holds."""
    return tuple(env._executor.simulation.points)


def test_without_things_it_is_the_environment_with_simulated_steps(empty):
    plain = MlivrEnv(dynamics="mujoco")
    options = {"plan": Planner(plain.graph).plan(START, GOAL, "steps").unwrap()}
    (seen, told), (other, _) = empty.reset(seed=0, options=options), plain.reset(options=options)
    assert all(np.array_equal(seen[key], value) for key, value in other.items())
    assert told["fewest_steps"] == len(options["plan"].steps)
    limb, point = options["plan"].actions[0]
    action = limb * len(plain.graph.grasp_map) + plain.graph.grasp_map.index(point)
    (seen, *ends, told), (other, *others, also) = empty.step(action), plain.step(action)
    assert ends == others
    for key, value in other.items():
        np.testing.assert_array_equal(seen[key], value)
    assert not seen["obstacles"].any()
    np.testing.assert_array_equal(told["action_mask"][:-1], also["action_mask"])
    for key in also.keys() - {"action_mask", *MEASURES}:
        np.testing.assert_array_equal(told[key], also[key])
    for key in ("peak_torque", "torque_rms", "peak_grasp_force", "step_time"):
        assert told[key] == pytest.approx(also[key], rel=0.02)  # it grasps after a look only


def test_what_is_seen_is_there_and_an_episode_arrives_in_no_less_than_the_fewest_steps(env):
    cell, policy = CELL * CUBE, ReplanningPolicy()
    origin = env.graph.grasp_map.cabin[0] - GRID_BORDER
    seen, info = env.reset(seed=3)
    ended, believed = False, 0
    while not ended:
        action = policy.act(env, seen, env.action_masks())
        seen, reward, ended, truncated, info = env.step(action)
        assert (reward, truncated) == (-1.0, False)
        low = origin + cell * np.argwhere(seen["obstacles"])
        for box in env.things:
            apart = np.maximum(low - box.centre, box.centre - low - cell) - box.half
            low = low[(apart > 0.05).any(axis=1)]
        assert not len(low)  # each cell has a thing in it, or at most noise away from it
        believed = max(believed, int(seen["obstacles"].sum()))
    assert believed
    assert info["is_success"]
    assert info["steps"] >= info["fewest_steps"] > 0
    assert held(env) == env.state.stance


@pytest.mark.parametrize("is_blocked", [False, True])
def test_an_attempt_in_vain_brings_the_limb_back_and_at_last_occupies_the_point(
    empty, monkeypatch, is_blocked
):
    """The point refuses the grasp, or something comes into the path to it."""
    if is_blocked:
        late = lambda _, trajectory, sample: sample > 0.3 * len(trajectory.times)  # noqa: E731
        monkeypatch.setattr(empty, "camera", DepthCamera(pixels=20, period=0.5))
        monkeypatch.setattr(Belief, "is_blocked", late)
    empty.reset(seed=0, options=TASK)
    action, state = first_action(empty), empty.state
    point = action % len(empty.graph.grasp_map)
    empty._executor.simulation.refusing = frozenset() if is_blocked else frozenset({point})
    for attempt in range(ATTEMPTS):
        seen, reward, ended, _, info = empty.step(action)
        assert (reward, ended) == (-1.0, False)
        assert (info["grasp_failed"], info["path_blocked"]) == (not is_blocked, is_blocked)
        assert empty.state.stance == held(empty) == state.stance
        assert seen["occupied"][point] == (attempt == ATTEMPTS - 1)
    assert info["action_mask"][action] == 0
    assert info["base_translation"] > 0.01  # there and back
    assert info["steps"] == ATTEMPTS
    empty.reset(seed=0, options=TASK)
    assert not empty.graph.occupied


def test_after_a_failure_no_action_is_taken(empty):
    empty.reset(seed=0, options=TASK)
    empty._executor.simulation.refusing = frozenset(range(len(empty.graph.grasp_map)))
    *_, ended, _, info = empty.step(first_action(empty))
    assert ended
    assert info["failure"]
    for action in (0, empty.action_space.n - 1):
        with pytest.raises(gymnasium.error.ResetNeeded):
            empty.step(action)


def test_relaxing_ends_in_a_stop_on_all_points(env):
    env.reset(seed=0, options=TASK)
    last = env.action_space.n - 1
    for is_stopped in (False, True):
        assert env.action_masks()[last]
        _, reward, ended, _, info = env.step(last)
        assert (reward, ended, info["is_stopped"]) == (-1.0, is_stopped, is_stopped)
    assert not info["is_success"]
    assert held(env) == env.state.stance
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)


def test_only_what_was_sensed_leaves_the_graph(env):
    known = Box.between("known", "obstacle", (-2.0, 0.5, -0.2), (-1.8, 0.7, 0.2))
    env.graph.add_obstacles([known])
    env.reset(seed=2)
    assert len(env.graph.obstacles) > 1
    with pytest.raises(MlivrError):
        env.reset(options={"goal": (9.0, 9.0, 9.0)})
    assert env.graph.obstacles == (known,)
    env.graph.remove_obstacles()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)


def test_fixed_tasks_have_fixed_things(env):
    things = []
    for seed in (1, 2):
        env.reset(seed=seed, options={"task": 5})
        things.append((env.state, env.goal.tolist(), env.things))
    assert things[0] == things[1]
    env.reset(seed=2, options={"task": 6})
    assert env.things != things[0][2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"dynamics": "kinematic"}, "'mujoco'"),
        ({"collisions": False}, "collisions is False"),
        ({"camera": {"pixel": 3}}, "pixel"),
        ({"tasks": "clutter"}, r"tasks is LayoutTasks\(.*, which draws layouts"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(MlivrError, match=message):
        ClosedLoopEnv(**arguments)


def test_things_leave_the_graph_if_planning_among_them_fails(empty, monkeypatch):
    def fails(*_, **__):
        raise SettingError("planning fails")

    monkeypatch.setattr(empty, "boxes", 1)
    monkeypatch.setattr(Planner, "plan", fails)
    with pytest.raises(SettingError, match="planning fails"):
        empty.reset(seed=0, options=TASK)
    assert not empty.graph.obstacles


def test_an_episode_that_begins_at_the_goal_ends_there(empty):
    goal = empty.graph.configuration(empty.graph.state(START))[0].tolist()
    _, info = empty.reset(seed=0, options={"start": START, "goal": goal})
    assert (info["is_success"], info["fewest_steps"]) == (True, 0)
    *_, ended, _, info = empty.step(first_action(empty))
    assert ended
    assert info["is_success"]


def test_more_plates_than_free_points_are_refused(env):
    with pytest.raises(SettingError, match="plates is 400"):
        unknown_things(env.graph, env.graph.state(START), np.random.default_rng(0), 0, 400)
