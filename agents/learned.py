"""Learned policies at work, and their files: weights beside the configuration of the training."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mlivr_gym.agents.features import env_features
from mlivr_gym.agents.hyperparameters import SIZES
from mlivr_gym.agents.networks import as_tensors, make_policy, scores_and_value
from mlivr_gym.agents.policies import PlanPolicy
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError, SettingError
from mlivr_gym.files import load, write_whole
from mlivr_gym.schema import Anything, Choice, Fields, Place
from mlivr_gym.settings import GRAPH_RULES, check_rules
from mlivr_gym.transitions.state import State

PRETRAINED = "pointer"
"""Name of the checkpoint that ships with the package, in `envs_assets`."""


CHECKPOINT = Fields({"network": Choice(tuple(SIZES.optional)), "sizes": Anything()}, others=True)
"""What loading needs of a checkpoint's configuration; the rest tells of the training."""


class CheckpointError(MlivrError):
    """A checkpoint cannot be read or does not fit the environment."""


class LearnedPolicy:
    """Takes the action with the best score among those that lead to a stance not yet visited.

    Visited are the stances of this episode; where all have been visited it takes the best of all.
    Without this rule a deterministic policy that steps back once steps back and forth for ever.

    Attributes:
        policy: The policy of sb3-contrib.
        network: `"pointer"` or `"mlp"`.
        config: What it was trained with.
    """

    def __init__(
        self, policy: Any, network: str, config: dict[str, Any] | None = None, memory: bool = True
    ) -> None:
        """Use a policy; `memory=False` lets it return to stances."""
        self.policy, self.network, self.config, self.memory = policy, network, config or {}, memory
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
        if self.memory:
            steps, stance = env.successors(), env.state.stance
            fresh = scores.copy()
            for limb, point in zip(steps.limb.tolist(), steps.point.tolist(), strict=True):
                if (*stance[:limb], point, *stance[limb + 1 :]) in self._visited:
                    fresh[limb * len(env.graph.grasp_map) + point] = -np.inf
            if np.isfinite(fresh).any():
                scores = fresh
        return int(scores.argmax())


def beam_walk(
    policy: LearnedPolicy, env: MlivrEnv, width: int, longest: int = 60
) -> list[int] | None:
    """Actions from the present state to the goal, by a beam search that a pointer policy guides.

    Each of the `width` most probable walks goes on by its most probable actions, and the first that
    arrives is taken. Walks never return to a stance that any of them has visited.

    Args:
        policy: A pointer policy.
        env: The environment.
        width: Walks kept.
        longest: Most steps.

    Returns:
        The actions, None if no walk to the goal is found.
    """
    m, tolerance = len(env.graph.grasp_map), env.goal_tolerance
    beam: list[tuple[float, State, list[int]]] = [(0.0, env.state, [])]
    seen = {env.state.stance}
    for _ in range(longest):
        states = [state for _, state, _ in beam]
        with torch.no_grad():
            scores, _ = scores_and_value(
                policy.policy, as_tensors(policy.policy, env_features(env, states))
            )
            chances = torch.log_softmax(scores, dim=1).numpy()
        found: list[tuple[float, State, list[int]]] = []
        arrived: list[tuple[float, list[int]]] = []
        for (chance, state, actions), logs in zip(beam, chances, strict=True):
            steps = env.moves.successors(state)
            numbers = steps.limb * m + steps.point
            there = np.linalg.norm(steps.base_in_world - env.goal, axis=1) <= tolerance
            arrived += [(chance + float(logs[a]), [*actions, int(a)]) for a in numbers[there]]
            for action in numbers[np.argsort(-logs[numbers], kind="stable")[: 2 * width]].tolist():
                found.append(
                    (
                        chance + float(logs[action]),
                        env.moves.take(state, action),
                        [*actions, action],
                    )
                )
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

    Raises:
        SettingError: If the policy is no pointer policy.
    """
    if policy.network != "pointer":
        raise SettingError(f"a beam needs a pointer policy; this one is {policy.network!r}")
    return PlanPolicy(lambda env: beam_walk(policy, env, width))


def save_policy(path: str | Path, policy: Any, config: dict[str, Any]) -> None:
    """Write `PATH.pt` with the weights and `PATH.json` with the configuration.

    Args:
        path: Path without suffix.
        policy: The policy.
        config: Everything it was trained with; `network` and `sizes` are needed to load it. The
            number of the graph's rules is added.
    """
    buffer = io.BytesIO()
    torch.save(policy.state_dict(), buffer)
    path = Path(path)
    config = config | {"rules": GRAPH_RULES}
    write_whole(path.with_suffix(".json"), json.dumps(config, indent=1) + "\n")
    write_whole(path.with_suffix(".pt"), buffer.getvalue())


def load_policy(path: str | Path, env: MlivrEnv) -> LearnedPolicy:
    """Read a policy for an environment.

    Args:
        path: Path without suffix, or `"pretrained"` for the checkpoint that ships with the package.
        env: The environment; the pointer policy fits every map and number of limbs.

    Raises:
        CheckpointError: If the files cannot be read, the network does not fit the environment, or
            it was trained under other rules of the stance graph.
    """
    file = asset_path(PRETRAINED) if str(path) == "pretrained" else Path(path)
    try:
        config = load(file.with_suffix(".json"), "checkpoint", CheckpointError, _configuration)
        weights = torch.load(file.with_suffix(".pt"), map_location="cpu", weights_only=True)
        policy = make_policy(env, config["network"], config["sizes"])
        if _shapes(weights) != _shapes(policy.state_dict()):
            raise CheckpointError(
                f"cannot use checkpoint {str(path)!r}: its weights are of other shapes than the "
                f"{config['network']} network of this version has for this environment; train it "
                "anew"
            )
        policy.load_state_dict(weights)
    except CheckpointError:
        raise
    except Exception as error:  # torch raises many kinds
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CheckpointError(f"cannot use checkpoint {str(path)!r}: {reason}") from None
    policy.set_training_mode(False)
    return LearnedPolicy(policy, config["network"], config)


def _shapes(weights: dict[str, Any]) -> dict[str, tuple[int, ...]]:
    """Shape of each tensor of a network by name."""
    return {name: tuple(tensor.shape) for name, tensor in weights.items()}


def _configuration(data: dict[str, Any]) -> dict[str, Any]:
    """The configuration of a checkpoint, what loading needs of it checked."""
    check_rules("it", data.get("rules"), "train it anew", CheckpointError)
    config = CHECKPOINT.read(data, Place("", CheckpointError))
    network = config["network"]
    sizes = SIZES.read({network: config["sizes"]}, Place("sizes", CheckpointError))
    return config | {"sizes": sizes[network]}
