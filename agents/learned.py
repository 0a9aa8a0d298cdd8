"""Learned policies, beam search with them, and checkpoints of weights with their configuration."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mlivr_gym.agents.features import env_features, point_space
from mlivr_gym.agents.hyperparameters import SIZES
from mlivr_gym.agents.networks import as_tensors, logits_and_value, make_actor_critic
from mlivr_gym.agents.policies import PlanPolicy
from mlivr_gym.arguments import FileName, InstanceOf, Reader, checked
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.observations import Observation, observation_space
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError, SettingError, shortened
from mlivr_gym.files import checksum, load, write_whole, written_together
from mlivr_gym.schema import NAME, Anything, Choice, FieldPath, Fields, Integer
from mlivr_gym.settings import GRAPH_RULES, check_rules
from mlivr_gym.sharing import Independent
from mlivr_gym.transitions.state import State

PRETRAINED = "pointer"
"""Name of the checkpoint that ships with the package, in `envs_assets`."""


FORMAT = 2
"""Version of the checkpoint format; files of version 1 have neither version nor checksum."""

MAX_WEIGHT = 1e3
"""Largest magnitude of a weight.

Through six layers of 256 such weights, from features of at most 100, no number exceeds 3e34, so
every logit is finite; larger weights may overflow single precision. Those that ship are at most
1.3.
"""

NETWORK = Choice(tuple(SIZES.optional))
"""Validator of the name of a network."""


def _stem(value: object, place: FieldPath) -> str:
    """Return the path of a checkpoint without suffix, which must have a name."""
    path = FileName().read(value, place)
    if not Path(path).name:
        raise place.refused(value, "the path of a checkpoint, without suffix")
    return path


STEM = Reader(_stem)
"""Validator of the path of a checkpoint to be written."""


def _plain(value: object, place: FieldPath) -> dict[str, Any]:
    """Return a configuration that JSON can hold."""
    found: dict[str, Any] = InstanceOf(dict).read(value, place)
    try:
        json.dumps({**found, "": None}, sort_keys=True)  # names that are no text have no order
    except (TypeError, ValueError, RecursionError):
        raise place.refused(value, "an object of plain data, with names") from None
    return found


PLAIN = Reader(_plain)
"""Validator of data that JSON can hold."""

BEAM = {"width": Integer(1, 10_000), "max_steps": Integer(1, 10_000)}
"""Validators of the figures of a beam search."""

MADE_FOR = Fields({"name": NAME, "fingerprint": NAME})
"""Validator of the name and fingerprint of a map, a robot or an observation."""

CHECKPOINT = Fields(
    {
        "network": NETWORK,
        "sizes": Anything(),
        **dict.fromkeys(("map", "robot", "observation"), MADE_FOR),
    },
    others=True,
)
"""Validator of the configuration; further fields describe the training and are not needed here."""


class CheckpointError(MlivrError):
    """A checkpoint cannot be read or does not fit the environment."""


class LearnedPolicy(Independent):
    """Policy that takes the most probable of the actions that lead to a new stance.

    New are stances that were not visited since the episode began or the graph last changed; if
    there are none, the most probable of all valid actions is taken. Without this rule a
    deterministic policy that once steps back and forth never stops. With the network `"pointer"`
    its input is computed from the environment (`env_features`), and the observation that `act`
    receives is not used; the other network is `"mlp"`. `config` is the configuration of the
    training, as in the file; empty if the policy was not loaded or trained here.
    """

    @checked({"network": NETWORK})
    def __init__(
        self, actor_critic: Any, network: str, config: dict[str, Any] | None = None
    ) -> None:
        """Wrap an actor-critic of sb3-contrib."""
        self.actor_critic, self.network, self.config = actor_critic, network, config or {}
        self._visited, self._version = set[tuple[int, ...]](), 0

    @checked()
    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return the action to take; see `Policy.act`."""
        logits = self.logits(env, observation)
        if logits.shape != mask.shape:
            raise CheckpointError(
                f"the policy has {len(logits)} actions and the environment {len(mask)}; use a "
                "policy that was made for this environment"
            )
        if env.steps == 0 or env.graph.version != self._version:
            self._visited.clear()
            self._version = env.graph.version
        self._visited.add(env.state.stance)
        logits = np.where(mask, logits, -np.inf)
        steps, fresh = env.successors(), logits.copy()
        for limb, point in zip(steps.limb.tolist(), steps.point.tolist(), strict=True):
            if env.state.stance_after(limb, point) in self._visited:
                fresh[limb * len(env.graph.grasp_map) + point] = -np.inf
        return int((fresh if np.isfinite(fresh).any() else logits).argmax())

    @checked()
    def logits(self, env: MlivrEnv, observation: Observation) -> NDArray[np.float32]:
        """Return the logit of each action in the present state, valid or not, shape (N m,)."""
        seen = (
            env_features(env)
            if self.network == "pointer"
            else {k: np.asarray(v)[None] for k, v in observation.items()}
        )
        with torch.no_grad():
            tensors = as_tensors(self.actor_critic, seen)
            found: NDArray[np.float32] = logits_and_value(self.actor_critic, tensors)[0][0].numpy()
        return found


@checked(BEAM)
def beam_search(
    policy: LearnedPolicy, env: MlivrEnv, width: int, max_steps: int = 60
) -> list[int] | None:
    """Return actions from the present state to the goal by a beam search, or None if it finds none.

    Each of the `width` most probable action sequences is extended by its most probable actions,
    whose results the steps of the environment tell, at most `max_steps` times. The probability of a
    sequence is the product of those of its actions. Of the shortest sequences that reach the goal
    the most probable one is returned. No sequence is extended to a stance that the beam has
    contained before. The policy must be a pointer policy.
    """
    m, tolerance = len(env.graph.grasp_map), env.goal_tolerance
    beam: list[tuple[float, State, list[int]]] = [(0.0, env.state, [])]
    seen = {env.state.stance}
    for _ in range(max_steps):
        states = [state for _, state, _ in beam]
        with torch.no_grad():
            seen_now = as_tensors(policy.actor_critic, env_features(env, states))
            logits, _ = logits_and_value(policy.actor_critic, seen_now)
            chances = torch.log_softmax(logits, dim=1).numpy()
        walks: list[tuple[float, State, list[int]]] = []
        arrived: list[tuple[float, list[int]]] = []
        for (chance, state, actions), logs in zip(beam, chances, strict=True):
            steps = env.moves.successors(state)
            numbers = steps.limb * m + steps.point
            there = np.linalg.norm(steps.base_position - env.goal, axis=1) <= tolerance
            arrived += [(chance + float(logs[a]), [*actions, int(a)]) for a in numbers[there]]
            for action in numbers[np.argsort(-logs[numbers], kind="stable")[: 2 * width]].tolist():
                after = env.moves.take(state, action)
                walks.append((chance + float(logs[action]), after, [*actions, action]))
        if arrived:
            return max(arrived, key=lambda pair: pair[0])[1]
        beam = []
        for entry in sorted(walks, key=lambda entry: -entry[0]):
            if entry[1].stance not in seen and len(beam) < width:
                seen.add(entry[1].stance)
                beam.append(entry)
        if not beam:
            return None
    return None


@checked(BEAM)
def beam_policy(policy: LearnedPolicy, width: int = 8) -> PlanPolicy:
    """Return a policy that follows the action sequences of a `beam_search` of some width.

    Raises a `SettingError` if the policy is not a pointer policy.
    """
    if policy.network != "pointer":
        raise SettingError(
            f"beam search needs a pointer policy; this policy has network {policy.network!r}"
        )
    return PlanPolicy(lambda env: beam_search(policy, env, width))


@checked({"path": STEM, "actor_critic": InstanceOf(torch.nn.Module), "config": PLAIN})
def save_policy(path: str | Path, actor_critic: Any, config: dict[str, Any]) -> None:
    """Write the weights to `PATH.pt` and the configuration to `PATH.json`, both or none.

    Loading needs `network`, `sizes` and the result of `made_for` in the configuration; format,
    number of the graph's rules and checksum are added here. Raises a `FileError` if a file cannot
    be written.
    """
    buffer = io.BytesIO()
    torch.save(actor_critic.state_dict(), buffer)
    path, weights = Path(path), buffer.getvalue()
    config = config | {"format": FORMAT, "rules": GRAPH_RULES}
    config.pop("checksum", None)  # that of the file from which the configuration was read
    config |= {"checksum": checksum(config, weights)}
    with written_together():
        write_whole(path.with_suffix(".json"), json.dumps(config, indent=1) + "\n")
        write_whole(path.with_suffix(".pt"), weights)


@checked({"network": NETWORK})
def made_for(env: MlivrEnv, network: str) -> dict[str, dict[str, str]]:
    """Return name and fingerprint of the map, the robot and the observation that a network is for.

    The fingerprint of an observation consists of the names of its parts and their last dimensions.
    """
    pointer, graph = network == "pointer", env.graph
    space = point_space(env) if pointer else observation_space(graph)
    parts = ", ".join(f"{name} {(part.shape or (0,))[-1]}" for name, part in space.items())
    return {
        "map": {"name": graph.grasp_map.name, "fingerprint": graph.grasp_map.fingerprint},
        "robot": {"name": graph.robot.name, "fingerprint": graph.robot.fingerprint},
        "observation": {"name": "points" if pointer else "plain", "fingerprint": parts},
    }


@checked()
def load_policy(path: str | Path, env: MlivrEnv) -> LearnedPolicy:
    """Return the policy of a checkpoint, ready to act in an environment.

    The path has no suffix; `"pretrained"` is the checkpoint that ships with the package. A pointer
    policy fits every map and robot, an MLP only those of its training. Raises a `CheckpointError`
    if a file cannot be read or was altered, a weight is not finite or too large, the network does
    not fit the environment, or it was trained by other rules of the stance graph.

    Examples
    --------
    >>> import gymnasium
    >>> env = gymnasium.make("mlivr_gym:MLIVR-JEM-v0").unwrapped
    >>> policy = load_policy("pretrained", env)
    >>> observation, info = env.reset(seed=0)
    >>> bool(env.action_masks()[policy.act(env, observation, env.action_masks())])
    True
    """
    file = asset_path(PRETRAINED) if str(path) == "pretrained" else Path(path)
    prefix = f"cannot use checkpoint {str(path)!r}"
    try:
        stored, read = file.with_suffix(".pt"), []

        def build(data: dict[str, Any]) -> dict[str, Any]:
            read.append(stored.read_bytes())
            return _configuration(data, read[0])

        config = load(file.with_suffix(".json"), "checkpoint", CheckpointError, build)
        _check_made_for(config, made_for(env, config["network"]), prefix)
        weights = _weights(read[0], prefix)
        actor_critic = make_actor_critic(env, config["network"], config["sizes"])
        if _shapes(weights) != _shapes(actor_critic.state_dict()):
            raise CheckpointError(
                f"{prefix}: its weights have other shapes than the {config['network']} network of "
                "this version has for this environment; train it again"
            )
        _check_weights(weights, prefix)
        actor_critic.load_state_dict(weights)
    except CheckpointError:
        raise
    except Exception as error:  # torch raises many types of errors
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CheckpointError(f"{prefix}: {reason}") from None
    actor_critic.set_training_mode(False)
    return LearnedPolicy(actor_critic, config["network"], config)


def _weights(content: bytes, prefix: str) -> dict[str, Any]:
    """Return the tensors of a file by name; raise a `CheckpointError` if it holds anything else.

    The reason of torch is not quoted, since it advises to load the file all the same.
    """
    try:
        weights = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception:  # torch raises many types of errors
        weights = None
    if isinstance(weights, dict) and all(map(torch.is_tensor, weights.values())):
        return weights
    raise CheckpointError(
        f"{prefix}: its file of weights is damaged or holds other things than tensors; "
        "train it again"
    )


def _shapes(weights: dict[str, Any]) -> dict[str, tuple[int, ...]]:
    """Return the shape of each tensor of a network by name."""
    return {name: tuple(tensor.shape) for name, tensor in weights.items()}


def _check_weights(weights: dict[str, Any], prefix: str) -> None:
    """Check that all weights are finite and not too large, so that every logit is finite."""
    for name, tensor in weights.items():
        wrong = tensor[~(tensor.abs() <= MAX_WEIGHT)]  # NaN does not satisfy it either
        if len(wrong):
            raise CheckpointError(
                f"{prefix}: its tensor {name!r} holds {wrong[0].item():g}; weights must be finite "
                f"and at most {MAX_WEIGHT:g} in size: train it again"
            )


def _check_made_for(config: dict[str, Any], here: dict[str, dict[str, str]], prefix: str) -> None:
    """Check that a network was made for this map, robot and observation.

    A pointer policy only needs the same observation, since it acts on every map and robot.
    """
    for what in ("observation",) if config["network"] == "pointer" else here:
        made, needed = config[what], here[what]
        if made["fingerprint"] != needed["fingerprint"]:
            raise CheckpointError(
                f"{prefix}: it was made for {what} {made['name']!r} ({made['fingerprint']}), not "
                f"for {needed['name']!r} ({needed['fingerprint']})"
            )


def _configuration(data: dict[str, Any], weights: bytes) -> dict[str, Any]:
    """Return the configuration of a checkpoint after checking the fields that loading needs.

    It is the content of a JSON file, which `weights`, that of the file of weights, must match.
    """
    if data.get("format") != FORMAT:
        raise CheckpointError(
            f"it has format {shortened(data.get('format', 1))}, and this version reads format "
            f"{FORMAT}, whose files carry a checksum: train it again"
        )
    check_rules("it", data.get("rules"), "train it again", CheckpointError)
    config = CHECKPOINT.read(data, FieldPath("", CheckpointError))
    network = config["network"]
    sizes = SIZES.read({network: config["sizes"]}, FieldPath("sizes", CheckpointError))
    found = checksum({k: value for k, value in data.items() if k != "checksum"}, weights)
    if data.get("checksum") != found:
        raise CheckpointError(
            f"its checksum is {shortened(data.get('checksum'))}, and that of the configuration "
            f"and the weights is {found!r}: a file was altered, or belongs to another; "
            "copy or train both again"
        )
    return config | {"sizes": sizes[network]}
