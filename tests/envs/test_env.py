"""The environment: Gymnasium's rules, episodes, what is observed, and steps in simulation."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from paper import NO_COLLISIONS

from mlivr_gym import Box, GraspMap, stance_graph
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.grasp_failure import failure_probabilities
from mlivr_gym.envs.observations import observation_space
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.stances.moves import TableMoves


@pytest.mark.parametrize("obstacles", [True, False])
def test_a_reset_that_is_refused_draws_no_number(small_map, obstacles):
    """What comes next is what would have come; without tables of steps and with them."""
    alike = [gymnasium.make("MLIVR-JEM-v0", map=small_map).unwrapped for _ in range(2)]
    for one in alike:
        one.reset(seed=3)
    graph = alike[0].graph
    shut_in = graph.points[0].tolist()
    graph.occupy(np.setdiff1d(np.arange(len(small_map)), shut_in).tolist())
    if obstacles:
        away = graph.base_position[0] + [0.9, 0.0, 0.0]
        graph.add_obstacles([Box.between("box", "obstacle", away - 0.01, away + 0.01)])
    else:
        alike[0].table_moves()
        assert isinstance(alike[0].moves, TableMoves)
    with pytest.raises(StanceError):
        alike[0].reset(options={"start": shut_in})
    graph.vacate()
    graph.remove_obstacles()
    assert data_equivalence(*(one.reset() for one in alike))


@pytest.mark.parametrize("change", [{"transitions": False}, {"grasp_failure": np.arange(38) / 380}])
def test_what_does_not_go_together_with_simulated_steps_is_refused(small_map, change):
    given = {"map": small_map, "collisions": False, **change}
    MlivrEnv(**given)
    with pytest.raises(SettingError, match=r"dynamics='(mujoco|kinematic)'"):
        MlivrEnv(dynamics="mujoco", **given)


def test_both_checkers_pass_with_dynamics():
    from stable_baselines3.common.env_checker import check_env as sb3_check

    physical_env = gymnasium.make("MLIVR-JEM-v0", dynamics="mujoco").unwrapped
    check_env(physical_env, skip_render_check=True)
    sb3_check(physical_env)


def test_a_plan_is_replayed_in_simulation(checked_graph, plan):
    physical_env = gymnasium.make("MLIVR-JEM-v0", dynamics="mujoco").unwrapped
    _, info = physical_env.reset(options={"plan": plan})
    other = pickle.loads(pickle.dumps(physical_env))
    assert info["failure"] is None
    assert info["stance"] == plan.stances[0]
    total, total_time, points = 0.0, 0.0, len(checked_graph.grasp_map)
    for k, (limb, point) in enumerate(plan.actions):
        action = limb * points + checked_graph.grasp_map.index(point)
        assert info["action_mask"][action]
        done = physical_env.step(action)
        assert k > 0 or data_equivalence(done, other.step(action))
        observation, reward, terminated, _, info = done
        total += reward
        assert info["failure"] is None
        assert info["stance"] == plan.stances[k + 1]
        assert 0.0 < info["capture_distance"] < 0.01
        total_time += info["step_time"]
        assert 0.0 < info["peak_torque"] < 0.8 * 150.0
        assert (observation["branches"].reshape(2, 16).sum(axis=1) == 1).all()
        np.testing.assert_allclose(
            physical_env._executor.configuration[2], plan.motion.joint_positions[k + 1], atol=0.05
        )
    assert terminated
    assert info["is_success"]
    assert total == -len(plan.steps)
    assert info["simulated_time"] == pytest.approx(total_time)
    assert 2.0 * len(plan.steps) < total_time < 20.0 * len(plan.steps)


@pytest.mark.parametrize(
    ("physics", "kind", "moves"),
    [({"capture_distance": 1e-9}, "missed grasp", True), ({"hold_force": 1.0}, "lost hold", False)],
)
def test_a_step_that_fails_ends_the_episode_with_its_reason(physics, kind, moves):
    """After the whole step, or at once: the support gives way while the gripper departs."""
    environment = gymnasium.make(
        "MLIVR-JEM-v0", reward="base", dynamics="mujoco", controller="feedforward", physics=physics
    ).unwrapped
    _, info = environment.reset(options={"start": ("D2a:4", "D1b:3"), "goal": (6.3, 0.5, 0.35)})
    stance, invalid = info["stance"], int(np.flatnonzero(info["action_mask"] == 0)[0])
    assert environment.step(invalid)[4]["simulated_time"] == 0.0
    at_rest = environment.snapshot.configuration(environment.graph)[0]
    steps = environment.successors()
    planned = np.linalg.norm(steps.base_position - info["base_position"], axis=1)
    k = int(np.argmax(planned))
    action = int(steps.limb[k]) * len(environment.graph.grasp_map) + int(steps.point[k])
    _, reward, terminated, truncated, info = environment.step(action)
    # The picture shows the last recorded sample before the failure.
    moved = np.linalg.norm(environment.snapshot.configuration(environment.graph)[0] - at_rest)
    assert reward == pytest.approx(-moved, abs=1e-4)
    assert info["base_translation"] == -reward
    assert planned[k] > 0.3
    assert moved > 0.1 if moves else moved < 0.05
    assert (terminated, truncated, info["steps"]) == (True, False, 2)
    assert info["failure"]["kind"] == kind
    assert info["stance"] == stance
    assert not info["is_success"]
    with pytest.raises(gymnasium.error.ResetNeeded, match="failed"):
        environment.step(invalid)
    environment.reset(seed=1)


def test_whole_cabin_and_every_point_lie_in_the_space():
    """A rail at the bottom of a high cabin, and one far outside."""
    rail = {"face": "deck", "normal": [0, 0, 1], "width": 0.02}
    low, high = [0.0, -1.0, 0.0], [2.0, 1.0, 9.0]
    ends = {"near": ([0, 0, 0], [1, 0, 0]), "far": ([9, 0, -9], [9.4, 0, -9])}
    segments = [{"id": k, "start": a, "end": b, **rail} for k, (a, b) in ends.items()]
    grasp_map = GraspMap.from_dict({"segments": segments, "cabin": {"min": low, "max": high}})
    space = observation_space(stance_graph(grasp_map, settings=NO_COLLISIONS))
    for place in (*np.array([low, high]), *grasp_map.positions):
        assert space["goal"].contains(place.astype(np.float32))
        assert space["base_position"].contains(place.astype(np.float32))
        assert space["grasps"].contains(np.tile(place, 2).astype(np.float32))


def test_failure_probabilities():
    drawn = failure_probabilities(20_000, 0.2, seed=1)
    assert drawn.mean() == pytest.approx(0.2, abs=0.005)
    assert drawn.min() >= 0.0
    assert drawn.max() <= 0.4
    np.testing.assert_array_equal(
        failure_probabilities(3, np.array([0.0, 0.5, 0.9])), [0.0, 0.5, 0.9]
    )
    assert failure_probabilities(20_000, 0.45).max() < 0.95
    for wrong in (0.46, np.array([0.0, 0.5]), np.array([0.0, 1.0, 0.5])):
        with pytest.raises(SettingError, match=r"grasp_failure.*(0 to 0\.45|3 numbers|0 to 0\.95)"):
            failure_probabilities(3, wrong)
