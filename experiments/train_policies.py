"""Train the policies that `planner_vs_rl.py` compares.

    python experiments/train_policies.py [--out runs] [--seeds 3] [--only dagger-pointer ...] \
        [--workers 1]

Writes `METHOD-NETWORK-SEED.pt` and `.json` for each policy by the command `mlivr-gym train`; a
checkpoint that exists is not trained again. The method `risky` is DAgger in an environment where
grasps fail with a mean probability of 0.2. PPO uses potential-based shaping, which does not change
the optimal policy. The checkpoint that ships with the package is `dagger-pointer-0`. Training and
comparison together take two to three hours (`make compare`).
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

from reports import command_line, study_rows

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


def trained(task: int, run: str, out: str) -> dict[str, Any]:
    """Train a policy with the seed of a task, unless its checkpoint exists."""
    path = Path(out) / f"{run}-{task}.pt"
    if not path.exists():
        options = [option.format(seed=task) for option in RUNS[run]]
        options += ["--network", run.split("-")[1], "--seed", str(task), "--out", path.stem]
        subprocess.run([sys.executable, "-m", "mlivr_gym", "train", *options], cwd=out, check=True)
    return {"checkpoint": path.name, "size": path.stat().st_size}


def main() -> None:
    """Train the policies, those that begin with another one last."""
    parser = command_line(__doc__, "runs", seeds=3, workers=1)
    parser.add_argument("--only", nargs="+", choices=RUNS, default=RUNS, help="some of them")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for is_last in (False, True):
        runs = [run for run in args.only if ("--init" in RUNS[run]) == is_last]
        if runs:
            where = {"run": runs, "out": [str(args.out.resolve())]}
            study_rows("train_policies:trained", args.seeds, args.workers, **where)


if __name__ == "__main__":
    main()
