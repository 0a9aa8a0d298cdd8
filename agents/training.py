"""Training of policies: behaviour cloning, DAgger, masked PPO, and PPO from a checkpoint."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mlivr_gym import __version__
from mlivr_gym.agents.hyperparameters import (
    METHODS,
    ImitationHyperparameters,
    check_hyperparameters,
    fill_dagger,
    load_hyperparameters,
)
from mlivr_gym.agents.imitation import Imitation
from mlivr_gym.agents.learned import STEM, LearnedPolicy, load_policy, made_for, save_policy
from mlivr_gym.agents.networks import actor_critic_class, make_actor_critic
from mlivr_gym.agents.sb3_env import TableVecEnv
from mlivr_gym.agents.test_set import held_out_goals
from mlivr_gym.arguments import SEED, InstanceOf, checked
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.plain_spec import plain_value
from mlivr_gym.errors import SettingError, choice
from mlivr_gym.schema import Choice, FieldPath, OrNone

Progress = Callable[[str, int, int, dict[str, float]], None]
"""Function called with the phase, the steps done, their total number, and figures by name."""


@checked({"method": Choice(METHODS), "seed": SEED, "out": OrNone(STEM)})
def train(
    method: str,
    network: str = "pointer",
    seed: int = 0,
    *,
    env: MlivrEnv | None = None,
    env_arguments: dict[str, Any] | None = None,
    hyperparameters: dict[str, Any] | None = None,
    init: str | Path | None = None,
    out: str | Path | None = None,
    command: str = "",
    progress: Progress | None = None,
    logs: str | Path | None = None,
) -> LearnedPolicy:
    """Train a policy for the two-limb environment, and return it.

    If the training is interrupted, `out` contains the policy learned so far. Raises a `MlivrError`
    if an argument cannot be used; the message names it.

    Parameters
    ----------
    method
        One of `hyperparameters.METHODS`.
    network
        One of `networks.NETWORKS`: `"pointer"` or `"mlp"`.
    seed
        Seed of all random numbers.
    env
        The environment, unwrapped (`env.unwrapped`); give it or `env_arguments`. If
        `gymnasium.make` made it, the configuration stores the arguments of its spec; otherwise they
        are not known and the configuration has None.
    env_arguments
        Arguments of `MlivrEnv`, from which the environment is made; by default none.
    hyperparameters
        Result of `load_hyperparameters`; by default those of the package. What they have is done:
        `imitation`, `ppo`, or both in this order.
    init
        Checkpoint to start from, without suffix, of the same network and sizes; `"finetune"` needs
        one.
    out
        Path of the checkpoint to write, without suffix.
    command
        Command that repeats the training, for the configuration.
    progress
        Function that is called with the phase (`"imitation"`: gradient steps, or `"ppo"`:
        environment steps), the steps done, their total number, and figures by name.
    logs
        Folder for TensorBoard logs; needs the package `tensorboard`.

    Examples
    --------
    A training that is much too short:

    >>> short = {"rounds": 1, "layouts": 1, "goals": 2, "rollouts": 2, "updates": 2}
    >>> policy = train("bc", hyperparameters={"imitation": short, "networks": {}})
    >>> policy.config["method"], policy.config["env"]
    ('bc', {})
    """
    choice("method", method, METHODS)
    if hyperparameters is None:
        hyperparameters = load_hyperparameters(method)
    hyperparameters = fill_dagger(method, check_hyperparameters(hyperparameters))
    if env is not None and env_arguments is not None:
        raise SettingError("env and env_arguments are both given; give one of them")
    if method == "finetune" and init is None:
        raise SettingError(
            "method 'finetune' needs a checkpoint to start from; give its path as init"
        )
    OrNone(InstanceOf(MlivrEnv)).read(env, FieldPath("env", SettingError))
    if env is None:
        env_arguments = env_arguments or {}
        env = MlivrEnv(**env_arguments)
    elif env.spec is not None:
        env_arguments = env.spec.kwargs
    used = {name: value for name, value in hyperparameters.items() if name != "networks"}
    if "imitation" in used:
        used["imitation"] = asdict(ImitationHyperparameters(**used["imitation"]))
    config = {
        "network": network,
        "sizes": dict(hyperparameters["networks"].get(network, {})),
        "method": method,
        "seed": seed,
        "env": None if env_arguments is None else _stored_arguments(env_arguments),
        "init": None if init is None else Path(init).name,
        "hyperparameters": used,
        **made_for(env, network),
        "version": __version__,
        "command": command,
        "versions": {
            "python": platform.python_version(),
            **{module.__name__: module.__version__ for module in (torch, np)},
        },
    }
    env.table_moves()
    return _train(config, env, init, _TrainingReport(progress, logs), out)


class _TrainingReport:
    """Reporter of the progress of a training to the caller and to TensorBoard."""

    def __init__(self, progress: Progress | None, logs: str | Path | None) -> None:
        """Report to a function, to a folder of TensorBoard logs, or to both."""
        self._progress, self._tensorboard_writer = progress, _tensorboard_writer(logs)
        self.learned = False

    def __call__(self, phase: str, done: int, total: int, figures: dict[str, float]) -> None:
        """Report the figures of a phase of the training."""
        self.learned = True
        if self._tensorboard_writer is not None:
            for name, value in figures.items():
                self._tensorboard_writer.add_scalar(f"{phase}/{name}", value, done)
        if self._progress is not None:
            self._progress(phase, done, total, figures)

    def close(self) -> None:
        """Finish the logs."""
        if self._tensorboard_writer is not None:
            self._tensorboard_writer.close()


def _train(
    config: dict[str, Any],
    env: MlivrEnv,
    init: str | Path | None,
    report: _TrainingReport,
    out: str | Path | None,
) -> LearnedPolicy:
    """Train, and write the checkpoint; on an interruption too, if anything was learned."""
    began, network, sizes = time.perf_counter(), config["network"], config["sizes"]
    torch.manual_seed(config["seed"])
    actor_critic = make_actor_critic(env, network, sizes)
    if init is not None:
        first = load_policy(init, env)
        try:
            actor_critic.load_state_dict(first.actor_critic.state_dict())
        except RuntimeError:
            raise SettingError(
                f"init {str(init)!r} has network {first.network!r} with sizes "
                f"{first.config['sizes']}, and this training has network {network!r} with "
                f"sizes {sizes}; train with network and sizes of the checkpoint"
            ) from None
    interrupted = False
    try:
        if "imitation" in config["hyperparameters"]:
            _run_imitation(config, env, actor_critic, report)
        if "ppo" in config["hyperparameters"]:
            _run_ppo(config, env, actor_critic, report)
    except KeyboardInterrupt:
        interrupted = True
    report.close()
    config["seconds"] = round(time.perf_counter() - began, 1)
    if interrupted:
        config["interrupted"] = True
    actor_critic.set_training_mode(False)
    outcome = "nothing was written"
    if out is not None and (report.learned or not interrupted):
        save_policy(out, actor_critic, config)
        outcome = f"{Path(out).with_suffix('.pt')} and .json hold what was learned so far"
    if interrupted:
        raise KeyboardInterrupt(f"training interrupted after {config['seconds']:.0f} s: {outcome}")
    return LearnedPolicy(actor_critic, network, config)


def _run_imitation(
    config: dict[str, Any], env: MlivrEnv, actor_critic: Any, report: _TrainingReport
) -> None:
    """Train an actor-critic in place by imitation of the expert."""
    given = ImitationHyperparameters(**config["hyperparameters"]["imitation"])
    plain = config["network"] == "mlp"
    imitation = Imitation(env, actor_critic, plain, given, config["seed"], held_out_goals())
    imitation.run(partial(report, "imitation"))


def _run_ppo(
    config: dict[str, Any], env: MlivrEnv, actor_critic: Any, report: _TrainingReport
) -> None:
    """Train an actor-critic in place by PPO; its weights are updated on an interruption too."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.callbacks import BaseCallback

    given, plain = config["hyperparameters"], config["network"] == "mlp"
    total = int(given["timesteps"])

    class Rollouts(BaseCallback):
        def _on_step(self) -> bool:
            return True

        def _on_rollout_end(self) -> None:
            ended = [episode["r"] for episode in self.model.ep_info_buffer or ()]
            figures = {"mean_return": float(np.mean(ended))} if ended else {}
            report("ppo", min(self.num_timesteps, total), total, figures)

    model = MaskablePPO(
        actor_critic_class(config["network"]),
        TableVecEnv(env, given["n_envs"], "plain" if plain else "points"),
        policy_kwargs=config["sizes"],
        seed=config["seed"],
        device="cpu",
        **given["ppo"],
    )
    model.policy.load_state_dict(actor_critic.state_dict())
    try:
        model.learn(total, callback=Rollouts())
    finally:
        actor_critic.load_state_dict(model.policy.state_dict())


def _stored_arguments(arguments: dict[str, Any]) -> dict[str, Any]:
    """Return arguments as data of JSON; an object that has no such form is replaced by its type."""

    def describe(value: Any) -> str:
        return f"not stored: an object of type {type(value).__module__}.{type(value).__qualname__}"

    stored: dict[str, Any] = json.loads(json.dumps(plain_value(arguments), default=describe))
    return stored


def _tensorboard_writer(logs: str | Path | None) -> Any:
    """Return a writer of TensorBoard logs, or None without a folder for them."""
    if logs is None:
        return None
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise SettingError(
            "TensorBoard logs need the package 'tensorboard': pip install tensorboard"
        ) from None
    return SummaryWriter(str(logs))
