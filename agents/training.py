"""Training of the policies by name: behaviour cloning, DAgger, masked PPO, and PPO from a checkpoint.

Hyperparameters are data: `envs_assets/training.json`.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch

from mlivr_gym import __version__
from mlivr_gym.agents.imitation import Imitation, ImitationSettings
from mlivr_gym.agents.learned import LearnedPolicy, load_policy, save_policy
from mlivr_gym.agents.networks import make_policy, policy_class
from mlivr_gym.agents.sb3_env import TableVecEnv
from mlivr_gym.agents.test_set import held_out_goals
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import SettingError, choice, shown
from mlivr_gym.files import read_json

METHODS = ("bc", "dagger", "ppo", "finetune")
"""Names of the training methods; `finetune` is PPO in small steps from a checkpoint."""

Progress = Callable[[str, int, int, dict[str, float]], None]


def hyperparameters(method: str, path: str | Path | None = None) -> dict[str, Any]:
    """Hyperparameters of a method from a JSON file, by default the one that ships with the package.

    Raises:
        SettingError: If the file cannot be read or lacks the method.
    """
    choice("method", method, METHODS)
    file = asset_path("training.json") if path is None else Path(path)
    data = read_json(file, "hyperparameters", SettingError)
    for name in (method, "networks"):
        if not isinstance(data.get(name), dict):
            raise SettingError(
                f"hyperparameters {str(file)!r} have no object {name!r}: {shown(data.get(name))}"
            )
    return {**data[method], "networks": data["networks"]}


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

    Args:
        method: One of `METHODS`.
        network: `"pointer"` or `"mlp"`.
        seed: Seed of everything.
        env: The environment, unwrapped; by default one is made.
        env_arguments: Arguments of `MlivrEnv`, which go into the configuration; the environment is
            made from them if none is given.
        settings: What `hyperparameters` returns; by default those of the package.
        init: Checkpoint without suffix to start from; `"finetune"` needs one.
        out: Where to write the checkpoint, without suffix.
        command: The command to repeat it, for the configuration.
        progress: Called with the phase, steps done, steps in all and figures.
        logs: Folder for TensorBoard logs; needs the package `tensorboard`.

    Raises:
        MlivrError: If an argument cannot be used; the message names it.
        KeyboardInterrupt: If it is interrupted; `out` then holds what was learned so far.
    """
    choice("method", method, METHODS)
    settings = hyperparameters(method) if settings is None else settings
    if method == "finetune" and init is None:
        raise SettingError("method 'finetune' needs a checkpoint to start from")
    arguments = dict(env_arguments or {})
    if env is None:
        made = gymnasium.make(
            "MLIVR-JEM-v0", disable_env_checker=True, **(arguments | {"precompute": True})
        ).unwrapped
        assert isinstance(made, MlivrEnv)
        env = made
    env.table_moves()
    writer = _writer(logs)
    began = time.perf_counter()
    learned = interrupted = False

    def tell(phase: str, done: int, total: int, figures: dict[str, float]) -> None:
        nonlocal learned
        learned = True
        if writer is not None:
            for name, value in figures.items():
                writer.add_scalar(f"{phase}/{name}", value, done)
        if progress is not None:
            progress(phase, done, total, figures)

    torch.manual_seed(seed)
    sizes = settings["networks"][network] if network in settings["networks"] else {}
    policy = make_policy(env, network, sizes)
    if init is not None:
        policy.load_state_dict(load_policy(init, env).policy.state_dict())
    try:
        if "imitation" in settings:
            imitation = Imitation(
                env,
                policy,
                network == "mlp",
                ImitationSettings(**settings["imitation"]),
                seed,
                held_out_goals(),
            )
            imitation.run(lambda done, total, figures: tell("imitation", done, total, figures))
        if "ppo" in settings:
            _improve(env, network, policy, sizes, settings, seed, tell)
    except KeyboardInterrupt:
        interrupted = True
    if writer is not None:
        writer.close()
    config = {
        "network": network, "sizes": sizes, "method": method, "seed": seed, "env": arguments,
        "init": None if init is None else Path(init).name,
        "settings": {name: value for name, value in settings.items() if name != "networks"},
        "map": env.graph.grasp_map.fingerprint, "robot": env.graph.robot.fingerprint,
        "version": __version__,
        "command": command, "seconds": round(time.perf_counter() - began, 1),
        "versions": {"python": platform.python_version(), "torch": torch.__version__, "numpy": np.__version__},
    }  # fmt: skip
    if interrupted:
        config["interrupted"] = True
    policy.set_training_mode(False)
    kept = "nothing was written"
    if out is not None and (learned or not interrupted):
        save_policy(out, policy, config)
        kept = f"{Path(out).with_suffix('.pt')} and .json hold what was learned so far"
    if interrupted:
        raise KeyboardInterrupt(f"training interrupted after {config['seconds']:.0f} s: {kept}")
    return LearnedPolicy(policy, network, config)


def _improve(
    env: MlivrEnv,
    network: str,
    policy: Any,
    sizes: dict[str, Any],
    settings: dict[str, Any],
    seed: int,
    tell: Progress,
) -> None:
    """PPO from a policy's weights, which are changed; also if it is interrupted."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.callbacks import BaseCallback

    total = int(settings["timesteps"])

    class Report(BaseCallback):
        def _on_step(self) -> bool:
            return True

        def _on_rollout_end(self) -> None:
            ended = [episode["r"] for episode in self.model.ep_info_buffer or ()]
            figures = {"mean_return": float(np.mean(ended))} if ended else {}
            tell("ppo", min(self.num_timesteps, total), total, figures)

    copies = TableVecEnv(env, settings["copies"], "plain" if network == "mlp" else "points")
    model = MaskablePPO(
        policy_class(network),
        copies,
        policy_kwargs=dict(sizes),
        seed=seed,
        device="cpu",
        **settings["ppo"],
    )
    model.policy.load_state_dict(policy.state_dict())
    try:
        model.learn(total, callback=Report())
    finally:
        policy.load_state_dict(model.policy.state_dict())


def _writer(logs: str | Path | None) -> Any:
    if logs is None:
        return None
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        raise SettingError("TensorBoard logs need the package 'tensorboard'") from None
    return SummaryWriter(str(logs))
