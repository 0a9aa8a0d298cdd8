"""Learned policies: how they act, alone and with a beam, and their checkpoints."""

import numpy as np
import pytest
import torch

from mlivr_gym.agents import evaluate
from mlivr_gym.agents.learned import (
    CheckpointError,
    LearnedPolicy,
    beam_policy,
    beam_walk,
    load_policy,
    save_policy,
)
from mlivr_gym.agents.networks import make_policy
from mlivr_gym.agents.training import train
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError
from mlivr_gym.planners import Planner


def test_a_policy_never_returns_to_a_stance(env, monkeypatch):
    """Not even one whose scores would step to and fro for ever."""
    learned = LearnedPolicy(make_policy(env, "mlp", {}), "mlp")
    scores = torch.arange(2.0 * len(env.graph.grasp_map))[None]
    monkeypatch.setattr("mlivr_gym.agents.learned.scores_and_value", lambda *_: (scores, None))
    forgets = LearnedPolicy(learned.policy, "mlp", memory=False)
    for policy in (learned, forgets):
        for seed in (0, 1):
            observation, info = env.reset(seed=seed)
            env.goal = np.array([50.0, 0.0, 0.0])  # never reached
            stances = [info["stance"]]
            for _ in range(8):
                observation, *_, info = env.step(policy.act(env, observation, env.action_masks()))
                stances.append(info["stance"])
            assert (len(set(stances)) == 9) == (policy is learned)


def test_a_long_walk_goes_to_the_best_stance_not_yet_visited_in_its_episode(ladder, monkeypatch):
    """Looked up in a list of what was visited; a few stances, so that all round have been at times.

    Where a stance was visited in an earlier episode only, it counts as new.
    """
    env = MlivrEnv(map=ladder, collisions=False, precompute=True)
    policy, m = LearnedPolicy(make_policy(env, "mlp", {}), "mlp"), len(env.graph.grasp_map)
    scores = np.random.default_rng(0).permutation(2 * m)
    told = torch.tensor(scores[None], dtype=torch.float32)
    monkeypatch.setattr("mlivr_gym.agents.learned.scores_and_value", lambda *_: (told, None))
    again, earlier, ever = 0, 0, set()
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        env.goal = np.array([50.0, 0.0, 0.0])  # never reached
        visited = []
        for _ in range(200):
            mask, stance = env.action_masks(), env.state.stance
            visited.append(stance)
            after = {
                a: (*stance[: a // m], a % m, *stance[a // m + 1 :]) for a in np.flatnonzero(mask)
            }
            fresh = [a for a, there in after.items() if there not in visited]
            best = max(fresh or after, key=lambda a: scores[a])
            action = policy.act(env, observation, mask)
            assert action == best
            again += not fresh
            earlier += after[action] in ever and bool(fresh)
            observation = env.step(action)[0]
        ever.update(visited)
    assert again > 50
    assert earlier > 50


def test_faulty_checkpoints_are_named(env, policy, tmp_path):
    with pytest.raises(CheckpointError, match=r"cannot read checkpoint.*nowhere"):
        load_policy(tmp_path / "nowhere", env)
    save_policy(tmp_path / "one", policy, {"network": "pointer", "sizes": {"width": 64}})
    told = r"cannot use checkpoint .*one': its weights are of other shapes .*; train it anew$"
    with pytest.raises(CheckpointError, match=told):
        load_policy(tmp_path / "one", env)
    mlp = LearnedPolicy(make_policy(env, "mlp", {}), "mlp")
    other = MlivrEnv(
        map=env.graph.grasp_map.subset(np.arange(len(env.graph.grasp_map)) % 4 > 0),
        collisions=False,
    )
    save_policy(tmp_path / "mlp", mlp.policy, {"network": "mlp", "sizes": {}})
    with pytest.raises(CheckpointError, match=r"cannot use checkpoint|actions|one map only"):
        load_policy(tmp_path / "mlp", other)
    with pytest.raises(SettingError, match="method is 'magic'"):
        train("magic", env=env)
    with pytest.raises(SettingError, match="network is 'cnn'"):
        train("bc", "cnn", env=env)


def test_a_beam_finds_walks_that_the_policy_alone_does_not(env, policy):
    """Even with random weights; a beam that keeps every stance finds the fewest steps."""
    learned, planner = LearnedPolicy(policy, "pointer"), Planner(env.graph)
    tasks = []
    for seed in range(40):
        env.reset(seed=seed)
        tasks.append((len(planner.plan(env.state.stance, env.goal, "steps").unwrap().steps), seed))
    for fewest, seed in sorted(tasks)[-4:]:
        env.reset(seed=seed)
        assert fewest > 2
        assert len(beam_walk(learned, env, len(env.graph))) == fewest
        actions = beam_walk(learned, env, 64)
        assert actions is not None
        for k, action in enumerate(actions):
            _, _, terminated, _, info = env.step(action)
            assert not info["invalid_action"]
            assert terminated == (k == len(actions) - 1)
    assert evaluate(env, beam_policy(learned, 64), 2).success.all()
    with pytest.raises(SettingError, match="needs a pointer policy"):
        beam_policy(LearnedPolicy(make_policy(env, "mlp", {}), "mlp"))


def test_the_shipped_checkpoint_acts_on_a_map_it_never_saw(env):
    policy = load_policy("pretrained", env)
    assert policy.config["network"] == "pointer"
    assert policy.config["command"].startswith("mlivr-gym train")
    assert evaluate(env, policy, 10, max_steps=30).success_rate >= 0.9
    assert evaluate(env, beam_policy(policy), 10).success.all()
