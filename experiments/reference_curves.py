"""Train reference learning curves on `MLIVR-JEM-Far-v0`: behaviour cloning, DAgger and masked PPO.

    python experiments/reference_curves.py [--seeds 3] [--out results]

The protocol is that of `docs/benchmark.md`: fixed tasks, step limit of an episode, metrics and
budget. Each method and seed is trained with the hyperparameters that ship with the package, in 7 to
17 minutes. Writes `reference_curves.json`, `reference_curves.md` and `reference_curves.png`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from matplotlib.figure import Figure
from random_layouts import fixed_tasks, protocol
from reports import NOTHING, experiment, study_rows, table
from tqdm import tqdm

from mlivr_gym.agents import ExpertPolicy, LearnedPolicy, RandomPolicy
from mlivr_gym.agents.hyperparameters import ImitationHyperparameters, load_hyperparameters
from mlivr_gym.agents.imitation import Imitation
from mlivr_gym.agents.networks import actor_critic_class, make_actor_critic
from mlivr_gym.agents.sb3_env import TableVecEnv
from mlivr_gym.envs import MlivrEnv
from mlivr_gym.pictures import save_figure

METHODS = {"dagger": "DAgger", "bc": "cloning", "ppo": "masked PPO"}
"""Methods, and their names in tables."""

TESTED = range(200)
"""Fixed tasks of the test."""

VALIDATED = range(1000, 1100)
"""Fixed tasks of the learning curves."""

ROLLOUTS = 5
"""Rollouts of PPO between two points of a curve."""

Measure = dict[str, Any]


def make_env() -> MlivrEnv:
    """Return the environment of the benchmark with all steps of its map computed."""
    env = gymnasium.make("MLIVR-JEM-Far-v0", disable_env_checker=True).unwrapped
    assert isinstance(env, MlivrEnv)
    env.table_moves()
    return env


class Curve:
    """Learning curve of a policy."""

    def __init__(self, env: MlivrEnv, bar: tqdm) -> None:
        """Compute the validation tasks and their fewest steps."""
        self.env, self._bar = env, bar
        self._given = fixed_tasks(env, VALIDATED)
        self.points: list[Measure] = []

    def add(self, actor_critic: Any, steps: int) -> None:
        """Evaluate an actor-critic of sb3-contrib after some environment steps."""
        actor_critic.set_training_mode(False)
        learned = LearnedPolicy(actor_critic, "pointer")
        self.points.append(protocol(self.env, learned, *self._given) | {"steps": steps})
        actor_critic.set_training_mode(True)
        self._bar.set_postfix(self.points[-1], refresh=False)


def imitate(method: str, seed: int, curve: Curve, bar: tqdm) -> Any:
    """Train by imitation, with a point of the curve after each round."""
    hyperparameters = load_hyperparameters(method)
    actor_critic = make_actor_critic(curve.env, "pointer", hyperparameters["networks"]["pointer"])
    given = ImitationHyperparameters(**hyperparameters["imitation"])
    imitation = Imitation(curve.env, actor_critic, False, given, seed)

    def progress(done: int, total: int, figures: dict[str, float]) -> None:
        bar.total, bar.n = total, done
        bar.update(0)
        if done % given.updates == 0:
            curve.add(actor_critic, int(figures["states"]))

    imitation.run(progress)
    return actor_critic


def improve(seed: int, curve: Curve, bar: tqdm) -> Any:
    """Train by masked PPO, with a point of the curve every few rollouts."""
    from sb3_contrib import MaskablePPO
    from stable_baselines3.common.callbacks import BaseCallback

    hyperparameters = load_hyperparameters("ppo")

    class Rollouts(BaseCallback):
        def _on_step(self) -> bool:
            return True

        def _on_rollout_start(self) -> None:
            bar.total, bar.n = hyperparameters["timesteps"], self.num_timesteps
            bar.update(0)
            if (
                self.num_timesteps // self.model.n_steps // hyperparameters["n_envs"] % ROLLOUTS
                == 0
            ):
                curve.add(self.model.policy, self.num_timesteps)

    model = MaskablePPO(
        actor_critic_class("pointer"),
        TableVecEnv(curve.env, hyperparameters["n_envs"], "points"),
        policy_kwargs=hyperparameters["networks"]["pointer"],
        seed=seed,
        device="cpu",
        **hyperparameters["ppo"],
    )
    model.learn(hyperparameters["timesteps"], callback=Rollouts())
    curve.add(model.policy, model.num_timesteps)
    return model.policy


def run_of(task: int, method: str) -> Measure:
    """Train once with the number of the task as seed, and evaluate on the tasks of the test."""
    torch.set_num_threads(1)
    torch.manual_seed(task)
    env, began = make_env(), time.perf_counter()
    with tqdm(desc=f"{method} {task}", mininterval=10.0) as bar:
        curve = Curve(env, bar)
        actor_critic = (
            improve(task, curve, bar) if method == "ppo" else imitate(method, task, curve, bar)
        )
    seconds = time.perf_counter() - began
    actor_critic.set_training_mode(False)
    learned = LearnedPolicy(actor_critic, "pointer")
    tested = protocol(env, learned, *fixed_tasks(env, TESTED))
    return {"curve": curve.points, "test": tested, "seconds": round(seconds, 1)}


def anchors() -> dict[str, Measure]:
    """Evaluate the methods that need no training on the tasks of the test."""
    env = make_env()
    tasks, fewest = fixed_tasks(env, TESTED)
    policies = {"exact table": ExpertPolicy(), "random possible steps": RandomPolicy(0)}
    found = {name: protocol(env, one, tasks, fewest) for name, one in policies.items()}
    return found | {"fewest": {"mean": float(np.mean(fewest)), "most": int(np.max(fewest))}}


def measured(seeds: int, workers: int) -> dict[str, Any]:
    """Train each method with each seed."""
    rows = study_rows("reference_curves:run_of", seeds, workers, method=list(METHODS))
    data: dict[str, Any] = {"anchors": anchors()}
    for row in rows:
        run = {name: row[name] for name in ("curve", "test", "seconds")}
        data.setdefault(row["method"], {})[str(row["task"])] = run
    return data


HEAD = (
    "method | seeds | success | steps over fewest | base translation [m] | environment steps | "
    "minutes to train"
)


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    fewest = data["anchors"]["fewest"]
    rows: list[list[Any]] = [
        [name, NOTHING, *cells([row]), NOTHING, NOTHING]
        for name, row in data["anchors"].items()
        if name != "fewest"
    ]
    for method, name in METHODS.items():
        runs = list(data.get(method, {}).values())
        if runs:
            steps = np.mean([run["curve"][-1]["steps"] for run in runs])
            minutes = np.mean([run["seconds"] for run in runs]) / 60.0
            tests = cells([run["test"] for run in runs])
            rows.append([name, len(runs), *tests, f"{steps:,.0f}", f"{minutes:.0f}"])
    return f"""# Reference curves on `MLIVR-JEM-Far-v0`

Made by `experiments/reference_curves.py` with the protocol of \
[`docs/benchmark.md`](../docs/benchmark.md). {len(TESTED)} fixed tasks; the fewest steps are \
{fewest["mean"]:.2f} on average and at most {fewest["most"]}. Means over training seeds, minimum \
and maximum in brackets.

{table(HEAD, rows)}
![Curves](reference_curves.png)
"""


def cells(tests: Sequence[Measure]) -> list[str]:
    """Return three table cells: success, steps over fewest, base translation."""
    found = []
    for name, form in (("success", ".3f"), ("over_fewest", ".3f"), ("base_translation_m", ".2f")):
        values = [test[name] for test in tests if test[name] is not None]
        text = format(np.mean(values), form) if values else NOTHING
        if len(values) > 1:
            text += f" [{min(values):{form}}, {max(values):{form}}]"
        found.append(text)
    return found


def draw(data: dict[str, Any], path: Path) -> None:
    """Plot success and steps over the fewest against environment steps."""
    figure = Figure(figsize=(10.0, 4.2), dpi=110, layout="constrained")
    success, over = figure.subplots(1, 2)
    looks = ("#1b6ca8", "o", 7), ("#2f8f5b", "s", 3), ("#c8553d", "^", 4)
    for (method, name), (colour, marker, size) in zip(METHODS.items(), looks, strict=True):
        style: dict[str, Any] = {"color": colour, "lw": 1.4, "alpha": 0.85, "marker": marker,
                                 "ms": size}  # fmt: skip
        for k, run in enumerate(data.get(method, {}).values()):
            label, curve = name if k == 0 else None, run["curve"]
            steps = [1e-3 * point["steps"] for point in curve]
            success.plot(steps, [100.0 * p["success"] for p in curve], label=label, **style)
            # A policy that never succeeds has no ratio.
            known = [np.nan if p["over_fewest"] is None else p["over_fewest"] for p in curve]
            over.plot(steps, known, label=label, **style)
    success.set(ylabel=f"success on {len(VALIDATED)} validation tasks [%]", ylim=(0.0, 102.0))
    over.set(ylabel="steps over fewest, where it succeeds", yscale="log")
    over.axhline(1.0, color="0.4", linewidth=0.9, linestyle=":")
    ticks = (1, 1.5, 2, 3, 5, 7)
    over.set_yticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    over.minorticks_off()
    for panel in (success, over):
        panel.set_xlabel("environment steps seen in training, in thousands")
        panel.grid(alpha=0.25)
    success.legend(frameon=False, loc="center right")
    save_figure(figure, path)


if __name__ == "__main__":
    experiment("reference_curves", __doc__, measured, markdown, draw, seeds=3, workers=1)
