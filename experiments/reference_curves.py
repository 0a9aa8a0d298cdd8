"""Train reference learning curves on `MLIVR-JEM-Far-v0`: behaviour cloning, DAgger and masked PPO.

    python experiments/reference_curves.py [--methods dagger ...] [--seeds 3] [--out results]

The protocol is that of `docs/benchmark.md`: fixed tasks, step limit of an episode, metrics and
budget. Each method and seed is trained with the hyperparameters that ship with the package, in 7 to
17 minutes. Runs are added to `reference_curves.json`, and a run that it holds is not repeated.
Writes `reference_curves.md` and `reference_curves.png`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from matplotlib.figure import Figure
from reports import NOTHING, command_line, keep, publish, read, table
from tqdm import tqdm

from mlivr_gym.agents import ExpertPolicy, RandomPolicy, evaluate
from mlivr_gym.agents.evaluation import EvaluationTask
from mlivr_gym.agents.hyperparameters import ImitationHyperparameters, load_hyperparameters
from mlivr_gym.agents.imitation import Imitation
from mlivr_gym.agents.learned import LearnedPolicy
from mlivr_gym.agents.networks import actor_critic_class, make_actor_critic
from mlivr_gym.agents.policies import Policy
from mlivr_gym.agents.sb3_env import TableVecEnv
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.tasks import fixed_task
from mlivr_gym.pictures.figures import save_figure

METHODS = {"dagger": "DAgger", "bc": "cloning", "ppo": "masked PPO"}
"""Methods, and their names in tables."""

TESTED = range(200)
"""Fixed tasks of the test."""

VALIDATED = range(1000, 1100)
"""Fixed tasks of the learning curves."""

MOST_STEPS = 60
"""Steps after which an episode counts as failed."""

ROLLOUTS = 5
"""Rollouts of PPO between two points of a curve."""

Measure = dict[str, Any]


def make_env() -> MlivrEnv:
    """Return the environment of the benchmark with all steps of its map computed."""
    env = gymnasium.make("MLIVR-JEM-Far-v0", disable_env_checker=True, precompute=True).unwrapped
    assert isinstance(env, MlivrEnv)
    return env


def tasks_of(env: MlivrEnv, numbers: range) -> list[EvaluationTask]:
    """Return fixed tasks as `evaluate` takes them."""
    found = []
    for k in numbers:
        task = fixed_task(env.tasks, env.graph, k, env.goal_tolerance)
        found.append(EvaluationTask(env.graph.ids(task.start.stance), tuple(task.goal.tolist())))
    return found


def measure(
    env: MlivrEnv, policy: Policy, tasks: Sequence[EvaluationTask], fewest: Sequence[int]
) -> Measure:
    """Return the metrics of the protocol: success, steps over the fewest, and base translation."""
    result = evaluate(env, policy, tasks, max_steps=MOST_STEPS)
    ratio = (result.steps / np.array(fewest))[result.success]
    moved = result.base_translation[result.success]
    return {
        "success": result.success_rate,
        "over_fewest": float(ratio.mean()) if len(ratio) else None,
        "base_translation_m": float(moved.mean()) if len(moved) else None,
    }


def fewest_steps(env: MlivrEnv, tasks: Sequence[EvaluationTask]) -> list[int]:
    """Return the fewest steps of each task, by the exact table."""
    found: list[int] = evaluate(env, ExpertPolicy(), tasks, max_steps=MOST_STEPS).steps.tolist()
    return found


class Curve:
    """Learning curve of a policy."""

    def __init__(self, env: MlivrEnv, bar: tqdm) -> None:
        """Compute the validation tasks and their fewest steps."""
        self.env, self._bar = env, bar
        self._tasks = tasks_of(env, VALIDATED)
        self._fewest = fewest_steps(env, self._tasks)
        self.points: list[Measure] = []

    def add(self, actor_critic: Any, steps: int) -> None:
        """Evaluate an actor-critic of sb3-contrib after some environment steps."""
        actor_critic.set_training_mode(False)
        learned = LearnedPolicy(actor_critic, "pointer")
        self.points.append(
            {"steps": steps, **measure(self.env, learned, self._tasks, self._fewest)}
        )
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


def run_of(method: str, seed: int) -> Measure:
    """Train once, and evaluate on the tasks of the test."""
    torch.manual_seed(seed)
    env, began = make_env(), time.perf_counter()
    with tqdm(desc=f"{method} {seed}", mininterval=10.0) as bar:
        curve = Curve(env, bar)
        actor_critic = (
            improve(seed, curve, bar) if method == "ppo" else imitate(method, seed, curve, bar)
        )
    seconds = time.perf_counter() - began
    actor_critic.set_training_mode(False)
    tasks = tasks_of(env, TESTED)
    tested = measure(env, LearnedPolicy(actor_critic, "pointer"), tasks, fewest_steps(env, tasks))
    return {"curve": curve.points, "test": tested, "seconds": round(seconds, 1)}


def anchors() -> dict[str, Measure]:
    """Evaluate the methods that need no training on the tasks of the test."""
    env = make_env()
    tasks = tasks_of(env, TESTED)
    fewest = fewest_steps(env, tasks)
    makes: dict[str, Callable[[], Policy]] = {
        "exact table": ExpertPolicy,
        "random possible steps": lambda: RandomPolicy(0),
    }
    found = {name: measure(env, make(), tasks, fewest) for name, make in makes.items()}
    return found | {"fewest": {"mean": float(np.mean(fewest)), "most": int(np.max(fewest))}}


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


def main() -> None:
    """Train the missing runs, and write page and figure."""
    parser = command_line(__doc__)
    parser.add_argument("--methods", nargs="*", choices=list(METHODS), default=list(METHODS))
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each")
    args = parser.parse_args()
    torch.set_num_threads(1)
    data = read(args.out, "reference_curves")
    if "anchors" not in data:
        data["anchors"] = anchors()
    for seed in range(args.seeds):
        for method in args.methods:
            if str(seed) not in data.setdefault(method, {}):
                data[method][str(seed)] = run_of(method, seed)
                keep(args.out, "reference_curves", data)
    publish(args.out, "reference_curves", data, markdown)
    draw(data, args.out / "reference_curves.png")


if __name__ == "__main__":
    main()
