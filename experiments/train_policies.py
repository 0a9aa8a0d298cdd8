"""Train the policies that `planner_vs_rl.py` compares.

    python experiments/train_policies.py [--out runs] [--seeds 3] [--only dagger-pointer ...]

Writes `METHOD-NETWORK-SEED.pt` and `.json` for each policy by the command `mlivr-gym train`; a
checkpoint that exists is not trained again. The method `risky` is DAgger in an environment where
grasps fail with a mean probability of 0.2. PPO uses potential-based shaping, which does not change
the optimal policy. The checkpoint that ships with the package is `dagger-pointer-0`. Training and
comparison together take two to three hours (`make compare`).
"""

from __future__ import annotations

import subprocess
import sys

from reports import command_line

GRASP_FAILURE = 0.2
"""Mean probability of a failing grasp in the family of unreliable grasps."""

RUNS = {
    "dagger-pointer": ["--method", "dagger"],
    "bc-pointer": ["--method", "bc"],
    "dagger-mlp": ["--method", "dagger"],
    "ppo-pointer": ["--method", "ppo", "--shaping"],
    "ppo-mlp": ["--method", "ppo", "--shaping"],
    "finetune-pointer": ["--method", "finetune", "--shaping", "--init", "dagger-pointer-{seed}"],
    "risky-pointer": ["--method", "dagger", "--grasp-failure", str(GRASP_FAILURE)],
}
"""Name with network, and options of `mlivr-gym train`, in the order of training."""


def main() -> None:
    """Train the policies in order, except those whose checkpoint exists."""
    parser = command_line(__doc__, out="runs")
    parser.add_argument("--seeds", type=int, default=3, help="seeds of each (default: %(default)s)")
    parser.add_argument("--only", nargs="+", choices=RUNS, default=RUNS, help="some of them")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for seed in range(args.seeds):
        for name in args.only:
            if (args.out / f"{name}-{seed}.pt").exists():
                continue
            options = [option.format(seed=seed) for option in RUNS[name]]
            options += ["--network", name.split("-")[1], "--seed", str(seed)]
            command = [sys.executable, "-m", "mlivr_gym", "train", *options]
            subprocess.run([*command, "--out", f"{name}-{seed}"], cwd=args.out, check=True)


if __name__ == "__main__":
    main()
