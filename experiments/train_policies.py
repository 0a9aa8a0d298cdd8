"""Train the policies that `planner_vs_rl.py` compares.

    python experiments/train_policies.py [--out runs] [--seeds 3] [--only dagger-pointer ...]
        [--hyperparameters FILE]

writes `METHOD-NETWORK-SEED.pt` and `.json` for each. `risky` in place of the method is DAgger where
grasps fail with probability 0.2 on average. PPO learns with potential-based shaping, which leaves
the best policy as it is. The checkpoint that ships with the package is `dagger-pointer-0`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from mlivr_gym.agents.hyperparameters import hyperparameters
from mlivr_gym.agents.training import train

RUNS = (
    "dagger-pointer",
    "bc-pointer",
    "dagger-mlp",
    "ppo-pointer",
    "ppo-mlp",
    "finetune-pointer",
    "risky-pointer",
)
"""What is trained, in this order."""

GRASP_FAILURE = 0.2
"""Mean probability that a grasp fails in the family of unreliable grasps."""


def main() -> None:
    """Train one after the other; a checkpoint that exists is kept."""
    parser = argparse.ArgumentParser(description="Train the policies that are compared.")
    parser.add_argument("--out", default="runs", help="folder (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each (default: %(default)s)")
    parser.add_argument("--only", nargs="+", choices=RUNS, default=RUNS, help="some of them")
    parser.add_argument(
        "--hyperparameters", help="JSON file (default: training.json of the package)"
    )
    args = parser.parse_args()
    torch.set_num_threads(1)
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    for seed in range(args.seeds):
        for run in args.only:
            path = out / f"{run}-{seed}"
            if path.with_suffix(".pt").exists():
                continue
            name, network = run.split("-")
            risky = name == "risky"
            method = "dagger" if risky else name
            arguments: dict[str, Any] = {"grasp_failure": GRASP_FAILURE} if risky else {}
            more = f" --grasp-failure {GRASP_FAILURE}" if risky else ""
            if method in ("ppo", "finetune"):
                arguments, more = {"shaping": True}, " --shaping"
            if method == "finetune":
                more += f" --init dagger-{network}-{seed}"
            command = f"mlivr-gym train --method {method} --network {network} --seed {seed}{more}"
            with tqdm(desc=path.name, mininterval=10.0) as bar:

                def show(
                    phase: str, done: int, total: int, figures: dict[str, float], bar: tqdm = bar
                ) -> None:
                    bar.total, bar.n = total, done
                    bar.set_postfix(figures, refresh=False)
                    bar.update(0)

                init = out / f"dagger-{network}-{seed}" if method == "finetune" else None
                train(
                    method,
                    network,
                    seed,
                    env_arguments=arguments,
                    settings=hyperparameters(method, args.hyperparameters),
                    init=init,
                    out=path,
                    command=command,
                    progress=show,
                )


if __name__ == "__main__":
    main()
