"""What the package promises, held against outside truth.

    python experiments/truth.py [--parts walks execution ...] [--small] [--out results]

* `walks`: random walks of legal steps are put together; `execution`: walks, and single steps from
  random states, are carried out in MuJoCo.
* `windows`: how many steps are no edges for the windows of the joints alone; `no`: how long it
  takes to say that there is no plan.
* `optimality`: plans against SciPy's Dijkstra over `successors`; `limbs`: the same for three and
  four limbs on small maps.
* `clearance`: steps past obstacles put beside them, by coal.
* `collisions`: stances, steps and plans against MuJoCo and coal, and what is called blocked.

Each part is kept in `truth.json` when it is done, and `truth.md` tells all that are there. The
numbers of each part are options; `--small` takes a hundredth.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from processes import Processes
from truth_answers import study_no, study_windows
from truth_clearance import study_clearance
from truth_collisions import study_collisions, tell_collisions
from truth_walks import study_execution, study_optimality, study_small_maps, study_walks

from mlivr_gym.files import write_whole

Part = dict[str, Any]


def tell_walks(part: Part) -> str:
    """Random walks in words."""
    swings = ", ".join(f"{name} {n}" for name, n in sorted(part["swings"].items()))
    return f"""**Legal means executable.** {part["walks"]} random walks of {part["steps"]} legal \
steps on the JEM with collisions: {part["went_on"]} went on to their last step, \
{part["put_together"]} were put together. Swings: {swings}.
"""


def tell_windows(part: Part) -> str:
    """The price of the rule in words."""
    lost, gone = part["lost"] / part["able"], part["gone"] / part["branches"]
    return f"""**Its price.** Of {part["able"]} random steps whose holding limb can follow the \
base {part["lost"]} ({100 * lost:.2f} %) are no edges since a joint would leave its window on \
every branch; {100 * gone:.2f} % of the branches are lost.
"""


def tell_no(part: Part) -> str:
    """Times of answers in words."""
    rows = "\n".join(
        f"| {name} | {part[name]['queries']} | {part[name]['median_ms']:.1f} | "
        f"{part[name]['p95_ms']:.1f} | {part[name]['largest_ms']:.0f} |"
        for name in ("yes", "no")
    )
    return f"""**How long yes and no take.** Two limbs, {part["points"]} points of the JEM, \
collisions on, random starts and goals, each asked on a graph that knows no step yet:

| there is a plan | queries | median [ms] | 95th percentile [ms] | largest [ms] |
|---|---|---|---|---|
{rows}
"""


def tell_clearance(part: Part) -> str:
    """Steps past obstacles in words."""
    rows = "\n".join(
        f"| {name} | {row['steps']} | {row['made']} | {row['configurations']} | "
        f"{1000 * row['least']:.2f} |"
        for name, row in part["obstacles"].items()
    )
    return f"""**Clear means clear.** Random steps with an obstacle put up to 50 mm beside a shape \
on the way, checked anew, and the motion sampled; least distances by coal, the clearance is \
{1000 * part["clearance"]:g} mm:

| obstacle | steps | still possible | configurations | least distance [mm] |
|---|---|---|---|---|
{rows}
"""


def tell_execution(part: Part) -> str:
    """Executions in words."""
    rows = "\n".join(
        f"| random {name} | {part[name]['number']} | {part[name]['steps']} | "
        + ", ".join(f"{end} {n}" for end, n in sorted(part[name]["ends"].items()))
        + " |"
        for name in ("walks", "steps")
    )
    return f"""**Carried out in MuJoCo**, {part["pace"]}:

| what | number | steps | ends |
|---|---|---|---|
{rows}
"""


def tell_optimality(part: Part) -> str:
    """Optimality for two limbs in words."""
    outcomes = ", ".join(f"{name} {n}" for name, n in sorted(part["outcomes"].items()))
    return f"""**Plans are optimal.** Two limbs, the JEM with {part["points"]} points, collisions \
on: {part["queries"]} random queries against SciPy's Dijkstra over all {part["states"]} states and \
{part["edges"]} steps that `successors` tells. {part["outcomes"].get("existence differs", 0)} \
differ in existence; of {part["found"]} plans found the cost differs by at most \
{part["largest_difference"]:.1e}. Outcomes: {outcomes}.
"""


def tell_limbs(part: Part) -> str:
    """Optimality for more limbs in words."""
    outcomes = ", ".join(f"{name} {n}" for name, n in sorted(part["outcomes"].items()))
    return f"""Three and four limbs, {part["maps"]} small maps, collisions on and off: the search \
from state to state, and that over the table of all nodes, against a Dijkstra in plain Python over \
all states: largest difference of cost \
{part["largest_difference"]:.1e} ({outcomes}).
"""


PARTS: dict[str, Callable[[Part], str]] = {
    "walks": tell_walks,
    "windows": tell_windows,
    "execution": tell_execution,
    "optimality": tell_optimality,
    "limbs": tell_limbs,
    "no": tell_no,
    "clearance": tell_clearance,
    "collisions": tell_collisions,
}
"""The parts, and what tells each."""


def told(known: dict[str, Part]) -> str:
    """The report of the parts that are known."""
    parts = [tell(known[name]) for name, tell in PARTS.items() if name in known]
    return "\n".join(
        ["# Promises against outside truth\n", "Made by `experiments/truth.py`.\n", *parts]
    )


def arguments() -> argparse.Namespace:
    """What the user asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--parts", nargs="*", choices=list(PARTS), default=list(PARTS), help="some, or none"
    )
    parser.add_argument("--walks", type=int, default=10_000, help="walks put together")
    parser.add_argument("--pairs", type=int, default=20_000, help="pairs of stances for windows")
    parser.add_argument("--unreachable", type=int, default=200, help="queries without a plan")
    parser.add_argument("--executed", type=int, default=300, help="walks carried out")
    parser.add_argument("--steps", type=int, default=2000, help="steps carried out")
    parser.add_argument("--queries", type=int, default=1000, help="queries of two limbs")
    parser.add_argument("--maps", type=int, default=540, help="small maps")
    parser.add_argument("--past", type=int, default=1500, help="steps past obstacles")
    parser.add_argument("--stances", type=int, default=2000, help="random free stances")
    parser.add_argument("--free", type=int, default=300, help="random free steps, sampled")
    parser.add_argument("--blocked", type=int, default=150, help="random blocked steps")
    parser.add_argument("--plans", type=int, default=200, help="random plans, sampled")
    parser.add_argument("--small", action="store_true", help="a hundredth of everything")
    parser.add_argument("--out", type=Path, default=Path("results"), help="folder for the results")
    parser.add_argument("--keep", type=Path, help="folder for single answers, to go on from")
    return parser.parse_args()


def main() -> None:
    """Run the parts that are asked for, and tell all that are known."""
    args = arguments()
    processes = Processes(len(os.sched_getaffinity(0)), args.keep)

    def size(name: str) -> int:
        return max(3, getattr(args, name) // (100 if args.small else 1))

    studies: dict[str, Callable[[], Part]] = {
        "walks": lambda: study_walks(size("walks"), processes),
        "windows": lambda: study_windows(size("pairs")),
        "execution": lambda: study_execution(size("executed"), size("steps"), processes),
        "optimality": lambda: study_optimality(size("queries"), max(3, size("queries") // 10)),
        "limbs": lambda: study_small_maps(size("maps"), processes),
        "no": lambda: study_no(size("unreachable")),
        "clearance": lambda: study_clearance(size("past"), processes),
        "collisions": lambda: study_collisions(
            size("stances"), size("free"), size("blocked"), size("plans")
        ),
    }
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "truth.json"
    known: dict[str, Part] = json.loads(path.read_text()) if path.exists() else {}
    for name in args.parts:
        known[name] = studies[name]()
        write_whole(path, json.dumps(known, indent=1) + "\n")
    write_whole(args.out / "truth.md", told(known))
    print(told(known))


if __name__ == "__main__":
    main()
