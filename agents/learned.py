"""Learned policies at work, and their files: weights beside the configuration of the training."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mlivr_gym.agents.features import env_features, point_space
from mlivr_gym.agents.hyperparameters import SIZES
from mlivr_gym.agents.networks import as_tensors, make_policy, scores_and_value
from mlivr_gym.agents.policies import PlanPolicy
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation, observation_space
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError, SettingError, shortened
from mlivr_gym.files import checksum, load, write_whole
from mlivr_gym.schema import NAME, Anything, Choice, FieldPath, Fields
from mlivr_gym.settings import GRAPH_RULES, check_rules
from mlivr_gym.transitions.state import State

PRETRAINED = "pointer"
"""Name of the checkpoint that ships with the package, in `envs_assets`."""


FORMAT = 2
"""Version of the checkpoint's format; files of the first carry neither version nor checksum."""

LARGEST_WEIGHT = 1e3
"""Largest size of a weight. Through six layers of 256 such weights, from features of at most 100,
nothing exceeds 3e34, so every score is finite; above it single precision may overflow. Those that
ship are at most 1.3."""

MADE_FOR = Fields({"name": NAME, "fingerprint": NAME})
"""A map, a robot or an observation."""

CHECKPOINT = Fields(
    {
        "network": Choice(tuple(SIZES.optional)),
        "sizes": Anything(),
        **dict.fromkeys(("map", "robot", "observation"), MADE_FOR),
    },
    others=True,
)
"""What loading needs of a checkpoint's configuration; the rest tells of the training."""


class CheckpointError(MlivrError):
    """A checkpoint cannot be read or does not fit the environment."""


class LearnedPolicy:
    """Takes the action with the best score among those that lead to a stance not yet visited.

    Visited are the stances of this episode; where all have been visited it takes the best of all.
    Without this rule a deterministic policy that steps back once steps back and forth for ever.

    Attributes
    ----------
    policy
        The policy of sb3-contrib.
    network
        `"pointer"` or `"mlp"`.
    config
        What it was trained with.
    """

    def __init__(self, policy: Any, network: str, config: dict[str, Any] | None = None) -> None:
        """Use a policy."""
        self.policy, self.network, self.config = policy, network, config or {}
        self._visited: set[tuple[int, ...]] = set()

    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """The action to take."""
        seen = (
            env_features(env)
            if self.network == "pointer"
            else {k: np.asarray(v)[None] for k, v in observation.items()}
        )
        with torch.no_grad():
            scores = scores_and_value(self.policy, as_tensors(self.policy, seen))[0][0].numpy()
        if scores.shape != mask.shape:
            raise CheckpointError(
                f"the policy has {len(scores)} actions, the environment {len(mask)}"
            )
        if env.steps == 0:
            self._visited.clear()
        self._visited.add(env.state.stance)
        scores = np.where(mask, scores, -np.inf)
        steps, fresh = env.successors(), scores.copy()
        for limb, point in zip(steps.limb.tolist(), steps.point.tolist(), strict=True):
            if env.state.stance_after(limb, point) in self._visited:
                fresh[limb * len(env.graph.grasp_map) + point] = -np.inf
        return int((fresh if np.isfinite(fresh).any() else scores).argmax())


def beam_walk(
    policy: LearnedPolicy, env: MlivrEnv, width: int, longest: int = 60
) -> list[int] | None:
    """Actions from the present state to the goal, by a beam search that a pointer policy guides.

    Each of the `width` most probable walks goes on by its most probable actions, and the first that
    arrives is taken. Walks never return to a stance that any of them has visited.

    Parameters
    ----------
    policy
        A pointer policy.
    env
        The environment.
    width
        Walks kept.
    longest
        Most steps.

    Returns
    -------
    list[int] | None
        The actions, None if no walk to the goal is found.
    """
    m, tolerance = len(env.graph.grasp_map), env.goal_tolerance
    beam: list[tuple[float, State, list[int]]] = [(0.0, env.state, [])]
    seen = {env.state.stance}
    for _ in range(longest):
        states = [state for _, state, _ in beam]
        with torch.no_grad():
            seen_now = as_tensors(policy.policy, env_features(env, states))
            scores, _ = scores_and_value(policy.policy, seen_now)
            chances = torch.log_softmax(scores, dim=1).numpy()
        found: list[tuple[float, State, list[int]]] = []
        arrived: list[tuple[float, list[int]]] = []
        for (chance, state, actions), logs in zip(beam, chances, strict=True):
            steps = env.moves.successors(state)
            numbers = steps.limb * m + steps.point
            there = np.linalg.norm(steps.base_in_world - env.goal, axis=1) <= tolerance
            arrived += [(chance + float(logs[a]), [*actions, int(a)]) for a in numbers[there]]
            for action in numbers[np.argsort(-logs[numbers], kind="stable")[: 2 * width]].tolist():
                after = env.moves.take(state, action)
                found.append((chance + float(logs[action]), after, [*actions, action]))
        if arrived:
            return max(arrived, key=lambda pair: pair[0])[1]
        beam = []
        for entry in sorted(found, key=lambda entry: -entry[0]):
            if entry[1].stance not in seen and len(beam) < width:
                seen.add(entry[1].stance)
                beam.append(entry)
        if not beam:
            return None
    return None


def beam_policy(policy: LearnedPolicy, width: int = 8) -> PlanPolicy:
    """Follows the walks of `beam_walk`.

    Raises
    ------
    SettingError
        If the policy is no pointer policy.
    """
    if policy.network != "pointer":
        raise SettingError(f"a beam needs a pointer policy; this one is {policy.network!r}")
    return PlanPolicy(lambda env: beam_walk(policy, env, width))


def save_policy(path: str | Path, policy: Any, config: dict[str, Any]) -> None:
    """Write `PATH.pt` with the weights and `PATH.json` with the configuration.

    Parameters
    ----------
    path
        Path without suffix.
    policy
        The policy.
    config
        Everything it was trained with; `network`, `sizes` and what `made_for` tells are
        needed to load it. Format, number of the graph's rules and checksum are added.
    """
    buffer = io.BytesIO()
    torch.save(policy.state_dict(), buffer)
    path, weights = Path(path), buffer.getvalue()
    config = config | {"format": FORMAT, "rules": GRAPH_RULES}
    config |= {"checksum": checksum(config, weights)}
    write_whole(path.with_suffix(".json"), json.dumps(config, indent=1) + "\n")
    write_whole(path.with_suffix(".pt"), weights)


def made_for(env: MlivrEnv, network: str) -> dict[str, dict[str, str]]:
    """What a network is made for: name and fingerprint of `map`, `robot` and `observation`.

    The fingerprint of an observation is the names of its parts and their last dimensions.
    """
    pointer, graph = network == "pointer", env.graph
    space = point_space(env) if pointer else observation_space(graph)
    parts = ", ".join(f"{name} {(part.shape or (0,))[-1]}" for name, part in space.items())
    return {
        "map": {"name": graph.grasp_map.name, "fingerprint": graph.grasp_map.fingerprint},
        "robot": {"name": graph.robot.name, "fingerprint": graph.robot.fingerprint},
        "observation": {"name": "points" if pointer else "plain", "fingerprint": parts},
    }


def load_policy(path: str | Path, env: MlivrEnv) -> LearnedPolicy:
    """Read a policy for an environment.

    Parameters
    ----------
    path
        Path without suffix, or `"pretrained"` for the checkpoint that ships with the package.
    env
        The environment; the pointer policy fits every map and robot, the MLP those alone that
        it was trained on.

    Raises
    ------
    CheckpointError
        If the files cannot be read or were altered, a weight is not finite or too
        large, the network was made for something else than the environment, or it was trained
        under other rules of the stance graph.
    """
    file = asset_path(PRETRAINED) if str(path) == "pretrained" else Path(path)
    told = f"cannot use checkpoint {str(path)!r}"
    try:
        stored, read = file.with_suffix(".pt"), []

        def build(data: dict[str, Any]) -> dict[str, Any]:
            read.append(stored.read_bytes())
            return _configuration(data, read[0])

        config = load(file.with_suffix(".json"), "checkpoint", CheckpointError, build)
        _check_made_for(config, made_for(env, config["network"]), told)
        weights = torch.load(io.BytesIO(read[0]), map_location="cpu", weights_only=True)
        policy = make_policy(env, config["network"], config["sizes"])
        if _shapes(weights) != _shapes(policy.state_dict()):
            raise CheckpointError(
                f"{told}: its weights are of other shapes than the {config['network']} network of "
                "this version has for this environment; train it anew"
            )
        _check_weights(weights, told)
        policy.load_state_dict(weights)
    except CheckpointError:
        raise
    except Exception as error:  # torch raises many kinds
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CheckpointError(f"{told}: {reason}") from None
    policy.set_training_mode(False)
    return LearnedPolicy(policy, config["network"], config)


def _shapes(weights: dict[str, Any]) -> dict[str, tuple[int, ...]]:
    """Shape of each tensor of a network by name."""
    return {name: tuple(tensor.shape) for name, tensor in weights.items()}


def _check_weights(weights: dict[str, Any], told: str) -> None:
    """Refuse weights with which no score could be trusted."""
    for name, tensor in weights.items():
        wrong = tensor[~(tensor.abs() <= LARGEST_WEIGHT)]  # NaN is not below it either
        if len(wrong):
            raise CheckpointError(
                f"{told}: its tensor {name!r} holds {wrong[0].item():g}; weights must be finite "
                f"and at most {LARGEST_WEIGHT:g} in size: train it anew"
            )


def _check_made_for(config: dict[str, Any], here: dict[str, dict[str, str]], told: str) -> None:
    """Refuse a network that was made for another map, robot or observation.

    That of a pointer policy is the same whatever the map and the robot.
    """
    for what in ("observation",) if config["network"] == "pointer" else here:
        made, needed = config[what], here[what]
        if made["fingerprint"] != needed["fingerprint"]:
            raise CheckpointError(
                f"{told}: it was made for {what} {made['name']!r} ({made['fingerprint']}), not for "
                f"{needed['name']!r} ({needed['fingerprint']})"
            )


def _configuration(data: dict[str, Any], weights: bytes) -> dict[str, Any]:
    """The configuration of a checkpoint, what loading needs of it checked.

    Parameters
    ----------
    data
        What its JSON file holds.
    weights
        What the file of its weights holds.
    """
    if data.get("format") != FORMAT:
        raise CheckpointError(
            f"it has format {shortened(data.get('format', 1))}, and this version reads format "
            f"{FORMAT}, whose files carry a checksum: train it anew"
        )
    check_rules("it", data.get("rules"), "train it anew", CheckpointError)
    config = CHECKPOINT.read(data, FieldPath("", CheckpointError))
    network = config["network"]
    sizes = SIZES.read({network: config["sizes"]}, FieldPath("sizes", CheckpointError))
    found = checksum({k: value for k, value in data.items() if k != "checksum"}, weights)
    if data.get("checksum") != found:
        raise CheckpointError(
            f"its checksum is {shortened(data.get('checksum'))}, and that of the configuration "
            f"and the weights is {found!r}: a file was altered, or belongs to another; "
            "copy or train both anew"
        )
    return config | {"sizes": sizes[network]}
