"""Learned policies: how they act, alone and with a beam, and their checkpoints."""

import errno
import json
import os
import re
from dataclasses import replace

import numpy as np
import pytest
import torch

from mlivr_gym.agents import evaluate
from mlivr_gym.agents.features import env_features
from mlivr_gym.agents.learned import (
    CheckpointError,
    LearnedPolicy,
    beam_policy,
    beam_search,
    load_policy,
    made_for,
    save_policy,
)
from mlivr_gym.agents.networks import as_tensors, logits_and_value, make_actor_critic
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError
from mlivr_gym.files import FileError, checksum
from mlivr_gym.planners import Planner
from mlivr_gym.world.grasp_map import GraspMap


def test_a_long_walk_goes_to_the_best_stance_not_yet_visited_in_its_episode(ladder, monkeypatch):
    """Looked up in a list of what was visited; a few stances, so that all round have been at times.

    A stance counts as new if it was visited in an earlier episode only, or before a point became
    occupied, since the walk may then have to go back.
    """
    env = MlivrEnv(map=ladder, collisions=False)
    policy, m = LearnedPolicy(make_actor_critic(env, "mlp", {}), "mlp"), len(env.graph.grasp_map)
    scores = np.random.default_rng(0).permutation(2 * m)
    told = torch.tensor(scores[None], dtype=torch.float32)
    monkeypatch.setattr("mlivr_gym.agents.learned.logits_and_value", lambda *_: (told, None))
    again, earlier, ever = 0, 0, set()
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        env.goal = np.array([50.0, 0.0, 0.0])  # never reached
        visited = []
        for k in range(400):
            if k == 200:
                env.graph.occupy([max(set(range(m)) - set(env.state.stance))])
                ever.update(visited)
                visited = []
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
        env.graph.vacate()
    assert again > 50
    assert earlier > 50


def kept(tmp_path, env, network="pointer", policy=None, **change):
    """A checkpoint of small networks, and the path it lies at."""
    sizes = {"pointer": {"width": 32, "summary": 16}, "mlp": {"net_arch": [8]}}[network]
    config = {"network": network, "sizes": sizes} | made_for(env, network) | change
    save_policy(tmp_path / "p", policy or make_actor_critic(env, network, sizes), config)
    return tmp_path / "p"


@pytest.mark.parametrize("suffix", [".pt", ".json"])
def test_a_checkpoint_is_replaced_as_a_pair(tmp_path, env, monkeypatch, suffix):
    """If one of its files cannot be, the old pair is there, and can be used."""
    path = kept(tmp_path, env, command="old")
    replace = os.replace

    def refuse(source, target):
        if str(target).endswith(suffix):
            raise OSError(errno.EBUSY, "in use")
        replace(source, target)

    monkeypatch.setattr("mlivr_gym.files.os.replace", refuse)
    with pytest.raises(FileError, match="in use"):
        kept(tmp_path, env, command="new")
    assert load_policy(path, env).config["command"] == "old"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["p.json", "p.pt"]
    monkeypatch.undo()
    kept(tmp_path, env, command="new")
    assert load_policy(path, env).config["command"] == "new"


@pytest.mark.parametrize("suffix", [".pt", ".json"])
def test_a_checkpoint_with_one_bit_flipped_is_refused(tmp_path, env, policy, suffix):
    """Wherever the bit lies."""
    path, rng = kept(tmp_path, env, policy=policy), np.random.default_rng(5)
    assert load_policy(path, env)
    file = path.with_suffix(suffix)
    whole = file.read_bytes()
    for bit in rng.choice(8 * len(whole), 60, replace=False).tolist():
        flipped = bytearray(whole)
        flipped[bit // 8] ^= 1 << bit % 8
        file.write_bytes(flipped)
        with pytest.raises(CheckpointError, match=r"^[^\n]*checkpoint '[^\n]*$"):
            load_policy(path, env)


@pytest.mark.parametrize("value", [float("nan"), -1001.0])
def test_weights_that_cannot_be_trusted_are_refused(tmp_path, env, policy, value):
    """The tensor is named; weights of the largest size allowed give finite scores."""
    tensor = policy.state_dict()["value_net.bias"]
    tensor[0] = value
    with pytest.raises(CheckpointError, match=r"its tensor 'value_net\.bias' holds (-|\d|nan|inf)"):
        load_policy(kept(tmp_path, env, policy=policy), env)
    for tensor in policy.state_dict().values():
        tensor.fill_(1000.0)
    observation, _ = env.reset(seed=0)
    loaded = load_policy(kept(tmp_path, env, policy=policy), env)
    scores = logits_and_value(
        loaded.actor_critic, as_tensors(loaded.actor_critic, env_features(env))
    )
    assert all(torch.isfinite(part).all() for part in scores)
    assert env.action_masks()[loaded.act(env, observation, env.action_masks())]


def test_a_checkpoint_made_for_something_else_is_refused(tmp_path, env, small_map):
    """Both are named, though all weights are of the right shapes."""
    mlp = kept(tmp_path, env, "mlp")
    assert load_policy(mlp, env)
    spec = {"name": "longer", "tool_length": 0.06}
    moved = GraspMap.from_dict(small_map.to_dict() | {"name": "moved"})
    moved = replace(moved, positions=moved.positions + np.array([0.1, 0.0, 0.0]))
    others = {
        "robot 'mlivr2' (": MlivrEnv(map=small_map, robot=spec, collisions=False),
        f"map {small_map.name!r} (": MlivrEnv(map=moved, collisions=False),
    }
    for (made, other), name in zip(others.items(), ("longer", "moved"), strict=True):
        told = rf"made for {re.escape(made)}\w+\), not for '{name}' \(\w+\)$"
        with pytest.raises(CheckpointError, match=told):
            load_policy(mlp, other)
        assert load_policy(kept(tmp_path / "..", env), other).network == "pointer"
    seen = {"name": "points", "fingerprint": "goal 6, limbs 24, points 8"}
    told = r"for observation 'points' \(goal 6, .*\), not for 'points' \(goal 5, .*\)$"
    with pytest.raises(CheckpointError, match=told):
        load_policy(kept(tmp_path, env, observation=seen), env)


def test_a_beam_finds_walks_that_the_policy_alone_does_not(env, policy):
    """Even with random weights; a beam that keeps every stance finds the fewest steps."""
    learned, planner = LearnedPolicy(policy, "pointer"), Planner(env.graph)
    tasks = []
    for seed in range(8):
        env.reset(seed=seed)
        tasks.append((len(planner.plan(env.state.stance, env.goal, "steps").unwrap().steps), seed))
    fewest, seed = max(tasks)
    env.reset(seed=seed)
    assert fewest > 2
    for search in (lambda: beam_search(learned, env, 0), lambda: beam_policy(learned, 0)):
        with pytest.raises(SettingError, match="width is 0; it must be a whole number from 1"):
            search()
    assert len(beam_search(learned, env, len(env.graph))) == fewest
    actions = beam_search(learned, env, 64)
    assert actions is not None
    for k, action in enumerate(actions):
        _, _, terminated, _, info = env.step(action)
        assert not info["invalid_action"]
        assert terminated == (k == len(actions) - 1)
    assert evaluate(env, beam_policy(learned, 64), 2).success.all()
    with pytest.raises(SettingError, match="needs a pointer policy"):
        beam_policy(LearnedPolicy(make_actor_critic(env, "mlp", {}), "mlp"))


def test_the_shipped_checkpoint_acts_on_a_map_it_never_saw(env):
    policy = load_policy("pretrained", env)
    assert policy.config["network"] == "pointer"
    assert policy.config["command"].startswith("mlivr-gym train")
    assert evaluate(env, policy, 10, max_steps=30).success_rate >= 0.9
    assert evaluate(env, beam_policy(policy), 10).success.all()


class Malicious:
    """What runs code when a careless program unpickles it."""

    def __reduce__(self):
        return os.mkdir, ("harmed",)


@pytest.mark.parametrize(
    "weights", [{"a\x1b]0;title\x07": Malicious()}, {"\x1b[2J": torch.zeros(1)}]
)
def test_a_malicious_checkpoint_is_refused_without_bad_advice(tmp_path, env, weights, monkeypatch):
    """Torch advises to load it all the same; names in it may hold what a terminal obeys."""
    monkeypatch.chdir(tmp_path)
    path, config = kept(tmp_path, env), json.loads((tmp_path / "p.json").read_text())
    torch.save(weights, path.with_suffix(".pt"))
    del config["checksum"]
    found = checksum(config, path.with_suffix(".pt").read_bytes())
    path.with_suffix(".json").write_text(json.dumps(config | {"checksum": found}))
    with pytest.raises(CheckpointError, match="cannot use checkpoint") as refused:
        load_policy(path, env)
    message = str(refused.value)
    assert message.isprintable()
    assert not any(word in message for word in ("weights_only", "torch.load", "trust"))
    assert not (tmp_path / "harmed").exists()
