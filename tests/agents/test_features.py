"""What networks see, and that order and number of points do not matter to them."""

import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

from mlivr_gym.agents.features import (
    ACTION_ARRIVALS,
    ACTION_DISTANCES,
    DEPTH,
    LIMB_FEATURES,
    PointObservation,
    env_features,
    point_lookahead,
)
from mlivr_gym.agents.networks import as_tensors, logits_and_value
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.stances.moves import Moves


def test_point_observation_is_an_environment(env):
    wrapped = PointObservation(
        gymnasium.make("MLIVR-JEM-v0", map=env.graph.grasp_map, collisions=False)
    )
    with pytest.raises(gymnasium.error.ResetNeeded):
        wrapped.action_masks()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version")
        check_env(wrapped, skip_render_check=True)


def test_features_are_positions_seen_from_the_robot(env):
    """Back in the world they are the points, the goal and the places the base moves to."""
    env.reset(seed=0)
    seen = {name: rows[0].astype(float) for name, rows in env_features(env).items()}
    posture, grasp_map = env.graph.posture(env.state.stance), env.graph.grasp_map
    base, rotation = posture.base_position[0], posture.base_rotation[0]
    np.testing.assert_allclose(
        seen["points"][:, :3] @ rotation.T + base, grasp_map.positions, atol=1e-5
    )
    np.testing.assert_allclose(seen["points"][:, 3:6] @ rotation.T, grasp_map.normals, atol=1e-5)
    np.testing.assert_allclose(rotation @ seen["goal"][:3] + base, env.goal, atol=1e-5)
    assert seen["goal"][3] == pytest.approx(np.linalg.norm(env.goal - base), abs=1e-5)
    assert seen["goal"][4] == pytest.approx(0.2)
    assert [int(row.argmax()) for row in seen["limbs"][:, :, 0]] == list(env.state.stance)
    np.testing.assert_array_equal(seen["limbs"][:, :, 1].ravel() > 0, env.action_masks())
    steps = env.successors()
    for limb, point, position in zip(steps.limb, steps.point, steps.base_position, strict=True):
        np.testing.assert_allclose(
            rotation @ seen["limbs"][limb, point, 2:5] + base, position, atol=1e-5
        )


def test_reach_is_the_nearest_base_of_all_stances_that_follow(env):
    """After one step any stance with the point, then any that keeps the point of the other limb."""
    graph, goal = env.graph, np.array([1.5, 0.0, 0.0])
    reach, held = point_lookahead(graph, goal, 0.2), (graph.branch_sets > 0).all(axis=1)
    distance = np.linalg.norm(graph.base_position - goal, axis=1)
    for limb in range(2):
        for point in range(0, len(graph.grasp_map), 3):
            stances, kept = held & (graph.points[:, limb] == point), limb
            for depth in range(DEPTH):
                assert reach[limb, point, depth] == pytest.approx(
                    distance[stances].min(initial=10.0), abs=1e-12
                )
                kept = 1 - kept
                stances = held & np.isin(graph.points[:, kept], graph.points[stances, kept])


def test_arrivals_are_the_sequences_of_stances_that_end_in_the_goal_region(env):
    """Counted one by one, the limbs moving in turns."""
    graph, tolerance = env.graph, 0.5
    goal = graph.base_position[40]
    held = (graph.branch_sets > 0).all(axis=1)
    stances = [tuple(pair) for pair in graph.points[held].tolist()]
    near = np.linalg.norm(graph.base_position[held] - goal, axis=1) <= tolerance
    arrives = dict(zip(stances, near.tolist(), strict=True))

    def arrivals(limb, point, steps):
        after = [pair for pair in stances if pair[limb] == point]
        if steps == 1:
            return sum(arrives[pair] for pair in after)
        return sum(arrivals(1 - limb, pair[1 - limb], steps - 1) for pair in after)

    found = point_lookahead(graph, goal, tolerance)[..., DEPTH:]
    for limb in range(2):
        for point in range(0, len(graph.grasp_map), 7):
            assert [arrivals(limb, point, n) for n in (1, 2, 3)] == found[limb, point, :3].tolist()
    assert near.any()
    assert found[..., 3].max() > found[..., 2].max() > 3


def test_an_action_tells_how_near_a_possible_step_after_it_leads(env):
    """From the environment, step by step: where the base is after two, and what follows them."""
    env.reset(seed=3)
    seen, graph = env_features(env)["limbs"][0], env.graph
    reach = point_lookahead(graph, env.goal, env.goal_tolerance)
    steps, some = env.successors(), 0
    for k, (limb, point) in enumerate(zip(steps.limb, steps.point, strict=True)):
        after = graph.successors(steps.after(env.state, k))
        away = np.linalg.norm(after.base_position - env.goal, axis=1)
        onward, arrivals = seen[limb, point, ACTION_DISTANCES], seen[limb, point, ACTION_ARRIVALS]
        assert onward[0] == pytest.approx(away.min(), rel=1e-6)
        assert 2.0 ** arrivals[0] - 1.0 == pytest.approx(
            (away <= env.goal_tolerance).sum(), abs=1e-4
        )
        for d in range(DEPTH):
            following = [reach[i, p, d] for i, p in zip(after.limb, after.point, strict=True)]
            counts = [reach[i, p, DEPTH + d] for i, p in zip(after.limb, after.point, strict=True)]
            assert onward[d + 1] == pytest.approx(min(following), rel=1e-6)
            assert arrivals[d + 1] == pytest.approx(np.log2(1.0 + sum(counts)), rel=1e-5, abs=1e-6)
        some += 1
    assert some > 10


def test_with_more_limbs_an_action_tells_where_the_base_is_after_it(jem):
    world = MlivrEnv(map=jem, robot="mlivr3", collisions=False)
    world.reset(seed=0)
    seen, steps = env_features(world)["limbs"][0], world.successors()
    away = np.linalg.norm(steps.base_position - world.goal, axis=1)
    onward = seen[steps.limb, steps.point, ACTION_DISTANCES]
    np.testing.assert_allclose(onward, np.tile(away[:, None], DEPTH + 1), rtol=1e-5)


def test_features_tell_points_that_are_taken_and_their_risk(small_map):
    risk = np.linspace(0.0, 0.5, len(small_map))
    world = MlivrEnv(map=small_map, collisions=False, grasp_failure=risk)
    world.graph.occupy([3, 8])
    world.reset(seed=0)
    points = env_features(world)["points"][0]
    assert np.flatnonzero(points[:, 6] == 0.0).tolist() == [3, 8]
    assert (np.delete(points[:, 6], [3, 8]) == 1.0).all()
    np.testing.assert_allclose(points[:, 7], risk, atol=1e-6)


def test_tables_and_graph_agree_on_who_may_let_go_next(small_map):
    """From states of walks among racks, where some limbs that hold cannot depart."""
    env = MlivrEnv(map=small_map)
    rng, graph_moves, differ = np.random.default_rng(0), Moves(env.graph), 0
    for seed in range(10):
        env.reset(seed=seed)
        for _ in range(6):
            steps = env.moves.successors(env.state)
            ours = env.table_moves().releasable_after(env.state, steps)
            np.testing.assert_array_equal(ours, graph_moves.releasable_after(env.state, steps))
            for k, (limb, point) in enumerate(
                zip(steps.limb.tolist(), steps.point.tolist(), strict=True)
            ):
                after = env.moves.take(env.state, limb * len(env.graph.grasp_map) + point)
                lets_go = env.graph.successors(after).limb != limb
                assert ours[k] or not lets_go.any()
            differ += not ours.all()
            env.step(int(rng.choice(np.flatnonzero(env.action_masks()))))
    assert differ > 0


def test_the_pointer_policy_does_not_depend_on_order_or_number(env, policy):
    """Scores are permuted with points and limbs; points neither free nor held change nothing."""
    env.reset(seed=1)
    seen = env_features(env)
    points, limbs = seen["points"], seen["limbs"]
    order = np.random.default_rng(0).permutation(len(env.graph.grasp_map))
    taken = np.tile([[[9.0, 9, 9, 0, 0, 1, 0, 0]]], (1, 7, 1))
    more = np.concatenate([limbs, np.zeros((1, 2, 7, LIMB_FEATURES))], axis=2)
    changed = {
        "turned": {"points": points[:, order], "limbs": limbs[:, :, order]},
        "longer": {"points": np.concatenate([points, taken], axis=1), "limbs": more},
        "swapped": {"limbs": limbs[:, ::-1]},
    }
    found, values = {}, []
    for name, change in {"as it is": {}, **changed}.items():
        rows = {key: array.astype(np.float32) for key, array in (seen | change).items()}
        with torch.no_grad():
            scores, value = logits_and_value(policy, as_tensors(policy, rows))
        found[name] = scores.numpy().reshape(2, -1)
        values.append(float(value))
    scores = found["as it is"]
    assert np.ptp(scores[limbs[0, :, :, 1] > 0]) > 0.1
    np.testing.assert_allclose(found["turned"], scores[:, order], atol=1e-4)
    np.testing.assert_allclose(found["longer"][:, :-7], scores, atol=1e-4)
    np.testing.assert_allclose(found["swapped"], scores[::-1], atol=1e-5)
    np.testing.assert_allclose(values, values[0], atol=1e-4)


@pytest.mark.parametrize("network", ["pointer", "mlp"])
def test_policies_run_in_maskable_ppo(small_map, network, tmp_path):
    """As in stable-baselines3: environments in processes or in this one, and saved models."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    from mlivr_gym.agents.networks import actor_critic_class

    vector = make_vec_env(
        "mlivr_gym:MLIVR-JEM-v0", n_envs=1, seed=0,
        vec_env_cls=SubprocVecEnv if network == "pointer" else DummyVecEnv,
        env_kwargs={"map": small_map, "collisions": False},
        wrapper_class=PointObservation if network == "pointer" else None,
    )  # fmt: skip
    try:
        model = MaskablePPO(actor_critic_class(network), vector, n_steps=16, batch_size=16, seed=0)
        model.learn(32)
        model.save(tmp_path / "model")
        loaded = MaskablePPO.load(tmp_path / "model")
        observation, masks = vector.reset(), np.stack(vector.env_method("action_masks"))
        chosen = [
            one.predict(observation, action_masks=masks, deterministic=True)[0]
            for one in (model, loaded)
        ]
        np.testing.assert_array_equal(*chosen)
        assert masks[0, chosen[0]].all()
    finally:
        vector.close()
