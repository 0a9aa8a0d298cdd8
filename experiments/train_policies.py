"""Train the policies that `planner_vs_rl.py` compares.

    python experiments/train_policies.py [--out runs] [--seeds 3] [--only dagger-pointer ...]
        [--hyperparameters FILE]

Writes `METHOD-NETWORK-SEED.pt` and `.json` for each policy; a checkpoint that exists is not trained
again. The method `risky` is DAgger in an environment where grasps fail with a mean probability of
0.2. PPO uses potential-based shaping, which does not change the optimal policy. The checkpoint that
ships with the package is `dagger-pointer-0`. Training and comparison together take two to three
hours (`make compare`).
"""

from __future__ import annotations

from typing import Any

import torch
from reports import command_line
from tqdm import tqdm

from mlivr_gym.agents.hyperparameters import load_hyperparameters
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
"""Method and network of each policy, in the order of training."""

GRASP_FAILURE = 0.2
"""Mean probability of a failing grasp in the family of unreliable grasps."""


def main() -> None:
    """Train the policies in order, except those whose checkpoint exists."""
    parser = command_line(__doc__, out="runs")
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each (default: %(default)s)")
    parser.add_argument("--only", nargs="+", choices=RUNS, default=RUNS, help="some of them")
    parser.add_argument(
        "--hyperparameters", help="JSON file (default: training.json of the package)"
    )
    args = parser.parse_args()
    torch.set_num_threads(1)
    out = args.out
    out.mkdir(parents=True, exist_ok=True)
    for seed in range(args.seeds):
        for run in args.only:
            path = out / f"{run}-{seed}"
            if path.with_suffix(".pt").exists():
                continue
            name, network = run.split("-")
            method, arguments, more = name, dict[str, Any](), ""
            if name == "risky":
                method, arguments = "dagger", {"grasp_failure": GRASP_FAILURE}
                more = f" --grasp-failure {GRASP_FAILURE}"
            if name in ("ppo", "finetune"):
                arguments, more = {"shaping": True}, " --shaping"
            init = f"dagger-{network}-{seed}" if name == "finetune" else None
            more += f" --init {init}" if init else ""
            command = f"mlivr-gym train --method {method} --network {network} --seed {seed}{more}"
            with tqdm(desc=path.name, mininterval=10.0) as bar:

                def show(
                    phase: str, done: int, total: int, figures: dict[str, float], bar: tqdm = bar
                ) -> None:
                    bar.total, bar.n = total, done
                    bar.set_postfix(figures, refresh=False)
                    bar.update(0)

                hyperparameters = load_hyperparameters(method, args.hyperparameters)
                train(
                    method, network, seed, env_arguments=arguments, hyperparameters=hyperparameters,
                    init=out / init if init else None, out=path, command=command, progress=show,
                )  # fmt: skip


if __name__ == "__main__":
    main()
