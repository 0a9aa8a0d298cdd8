"""Training of the policies: behaviour cloning, DAgger, masked PPO, and PPO from a checkpoint."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mlivr_gym import __version__
from mlivr_gym.agents.hyperparameters import (
    METHODS,
    ImitationSettings,
    checked_settings,
    hyperparameters,
)
from mlivr_gym.agents.imitation import Imitation
from mlivr_gym.agents.learned import LearnedPolicy, load_policy, made_for, save_policy
from mlivr_gym.agents.networks import make_policy, policy_class
from mlivr_gym.agents.sb3_env import TableVecEnv
from mlivr_gym.agents.test_set import held_out_goals
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import SettingError, choice

Progress = Callable[[str, int, int, dict[str, float]], None]
"""Called with the phase, the steps done, the steps in all and figures."""


def train(
    method: str,
    network: str = "pointer",
    seed: int = 0,
    *,
    env: MlivrEnv | None = None,
    env_arguments: dict[str, Any] | None = None,
    settings: dict[str, Any] | None = None,
    init: str | Path | None = None,
    out: str | Path | None = None,
    command: str = "",
    progress: Progress | None = None,
    logs: str | Path | None = None,
) -> LearnedPolicy:
    """Train a policy for the two-limb environment.

    Parameters
    ----------
    method
        One of `METHODS`.
    network
        `"pointer"` or `"mlp"`.
    seed
        Seed of everything.
    env
        The environment, unwrapped; by default one is made.
    env_arguments
        Arguments of `MlivrEnv`, which go into the configuration; the environment is
        made from them if none is given.
    settings
        What `hyperparameters` returns; by default those of the package.
    init
        Checkpoint without suffix to start from; `"finetune"` needs one.
    out
        Where to write the checkpoint, without suffix.
    command
        The command to repeat it, for the configuration.
    progress
        Called with the phase, the steps done, the steps in all and figures.
    logs
        Folder for TensorBoard logs; needs the package `tensorboard`.

    Raises
    ------
    MlivrError
        If an argument cannot be used; the message names it.
    KeyboardInterrupt
        If it is interrupted; `out` then holds what was learned so far.
    """
    choice("method", method, METHODS)
    settings = hyperparameters(method) if settings is None else checked_settings(settings)
    if method == "finetune" and init is None:
        raise SettingError("method 'finetune' needs a checkpoint to start from")
    request = _Request(method, network, seed, dict(env_arguments or {}), settings, init, command)
    env = request.make_env() if env is None else env
    env.table_moves()
    return _train(request, env, _Report(progress, logs), out)


@dataclass(frozen=True)
class _Request:
    """What shall be trained and how: the arguments of `train`."""

    method: str
    network: str
    seed: int
    env_arguments: dict[str, Any]
    settings: dict[str, Any]
    init: str | Path | None
    command: str

    @property
    def sizes(self) -> dict[str, Any]:
        """Sizes of the network, as arguments of its class."""
        return dict(self.settings["networks"].get(self.network, {}))

    def make_env(self) -> MlivrEnv:
        """The environment, with the steps of its whole map worked out."""
        return MlivrEnv(**(self.env_arguments | {"precompute": True}))

    def config(self, env: MlivrEnv, seconds: float) -> dict[str, Any]:
        """What a checkpoint says of its training."""
        return {
            "network": self.network,
            "sizes": self.sizes,
            "method": self.method,
            "seed": self.seed,
            "env": self.env_arguments,
            "init": None if self.init is None else Path(self.init).name,
            "settings": {k: value for k, value in self.settings.items() if k != "networks"},
            **made_for(env, self.network),
            "version": __version__,
            "command": self.command,
            "seconds": round(seconds, 1),
            "versions": {
                "python": platform.python_version(),
                **{module.__name__: module.__version__ for module in (torch, np)},
            },
        }


class _Report:
    """Tells the caller and TensorBoard how a training goes.

    Attributes
    ----------
    learned
        Whether anything was learned yet.
    """

    def __init__(self, progress: Progress | None, logs: str | Path | None) -> None:
        """Tell whom there is: a function, or a folder for TensorBoard logs."""
        self._progress, self._writer = progress, _writer(logs)
        self.learned = False

    def __call__(self, phase: str, done: int, total: int, figures: dict[str, float]) -> None:
        """Tell the figures of a phase of the training."""
        self.learned = True
        if self._writer is not None:
            for name, value in figures.items():
                self._writer.add_scalar(f"{phase}/{name}", value, done)
        if self._progress is not None:
            self._progress(phase, done, total, figures)

    def close(self) -> None:
        """Finish the logs."""
        if self._writer is not None:
            self._writer.close()


def _train(
    request: _Request, env: MlivrEnv, report: _Report, out: str | Path | None
) -> LearnedPolicy:
    """Train, and write the checkpoint also where it is interrupted after something was learned."""
    began = time.perf_counter()
    torch.manual_seed(request.seed)
    policy = make_policy(env, request.network, request.sizes)
    if request.init is not None:
        policy.load_state_dict(load_policy(request.init, env).policy.state_dict())
    interrupted = False
    try:
        if "imitation" in request.settings:
            _imitate(request, env, policy, report)
        if "ppo" in request.settings:
            _improve(request, env, policy, report)
    except KeyboardInterrupt:
        interrupted = True
    report.close()
    config = request.config(env, time.perf_counter() - began)
    if interrupted:
        config["interrupted"] = True
    policy.set_training_mode(False)
    kept = "nothing was written"
    if out is not None and (report.learned or not interrupted):
        save_policy(out, policy, config)
        kept = f"{Path(out).with_suffix('.pt')} and .json hold what was learned so far"
    if interrupted:
        raise KeyboardInterrupt(f"training interrupted after {config['seconds']:.0f} s: {kept}")
    return LearnedPolicy(policy, request.network, config)


def _imitate(request: _Request, env: MlivrEnv, policy: Any, report: _Report) -> None:
    """Imitation of the planner by a policy, which is changed; also if it is interrupted."""
    settings = ImitationSettings(**request.settings["imitation"])
    plain = request.network == "mlp"
    imitation = Imitation(env, policy, plain, settings, request.seed, held_out_goals())
    imitation.run(partial(report, "imitation"))


def _improve(request: _Request, env: MlivrEnv, policy: Any, report: _Report) -> None:
    """PPO from a policy's weights, which are changed; also if it is interrupted."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.callbacks import BaseCallback

    settings, plain = request.settings, request.network == "mlp"
    total = int(settings["timesteps"])

    class Rollouts(BaseCallback):
        def _on_step(self) -> bool:
            return True

        def _on_rollout_end(self) -> None:
            ended = [episode["r"] for episode in self.model.ep_info_buffer or ()]
            figures = {"mean_return": float(np.mean(ended))} if ended else {}
            report("ppo", min(self.num_timesteps, total), total, figures)

    model = MaskablePPO(
        policy_class(request.network),
        TableVecEnv(env, settings["copies"], "plain" if plain else "points"),
        policy_kwargs=request.sizes,
        seed=request.seed,
        device="cpu",
        **settings["ppo"],
    )
    model.policy.load_state_dict(policy.state_dict())
    try:
        model.learn(total, callback=Rollouts())
    finally:
        policy.load_state_dict(model.policy.state_dict())


def _writer(logs: str | Path | None) -> Any:
    """A writer of TensorBoard logs, None without a folder for them."""
    if logs is None:
        return None
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise SettingError("TensorBoard logs need the package 'tensorboard'") from None
    return SummaryWriter(str(logs))
