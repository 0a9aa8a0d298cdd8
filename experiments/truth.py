"""Check the promises of the package against independent programs.

    python experiments/truth.py [--walks 10000] [--workers 2] [--out results]

* `walks`: random walks of valid steps must give complete motions.
* `execution`: random walks, and single steps from random states, are carried out in MuJoCo.
* `optimality`: costs of plans are compared with SciPy's Dijkstra over `successors`; `limbs`: the
  same for three and four limbs on small maps.
* `clearance`: coal measures the distances along steps past obstacles.
* `collisions`: MuJoCo and coal check stances, steps and plans that are called free, and count what
  is called blocked; `motions`: the motions of steps of five robots.

Options set the size of each part. Writes `truth.json` and `truth.md`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from reports import CORES, counted, experiment, table
from truth_collisions import study_clearance, study_collisions
from truth_motions import study_motions
from truth_walks import study_execution, study_optimality, study_small_maps, study_walks

from mlivr_gym.collisions import ALLOWED_COLLISIONS

Part = dict[str, Any]


def walks_text(part: Part) -> str:
    """Return the paragraph on random walks."""
    return f"""**Valid steps are executable.** {part["walks"]} random walks of {part["steps"]} \
valid steps on the JEM with collisions: {part["went_on"]} reach their last step, \
{part["put_together"]} have a complete motion. Swings: {counted(part["swings"])}.
"""


def execution_text(part: Part) -> str:
    """Return the paragraph on executions in MuJoCo."""
    rows = [
        [f"random {name}", part[name]["number"], part[name]["steps"], counted(part[name]["ends"])]
        for name in ("walks", "steps")
    ]
    return f"**Execution in MuJoCo**, {part['pace']}:\n\n" + table(
        "what | number | steps | ends", rows
    )


def optimality_text(part: Part) -> str:
    """Return the paragraph on optimality for two limbs."""
    return f"""**Plans are optimal.** Two limbs, the JEM with {part["points"]} points, collisions \
on: {part["queries"]} random queries against SciPy's Dijkstra over all {part["states"]} states and \
{part["edges"]} steps that `successors` yields. {part["outcomes"].get("existence differs", 0)} \
differ in existence; the costs of {part["found"]} plans differ by at most \
{part["largest_difference"]:.1e}. Outcomes: {counted(part["outcomes"])}.
"""


def limbs_text(part: Part) -> str:
    """Return the paragraph on optimality for three and four limbs."""
    return f"""Three and four limbs, {part["maps"]} small maps, collisions on and off, against a \
Dijkstra in plain Python over all states: largest cost difference \
{part["largest_difference"]:.1e} ({counted(part["outcomes"])}).
"""


def clearance_text(part: Part) -> str:
    """Return the paragraph on steps past obstacles."""
    rows = [
        [name, row["steps"], row["made"], row["configurations"], f"{1000 * row['least']:.2f}"]
        for name, row in part["obstacles"].items()
    ]
    head = "obstacle | steps | still possible | configurations | minimum distance [mm]"
    return f"""**The clearance is kept.** Random steps with an obstacle up to 50 mm from a shape \
on their motion are checked again, and the motion is sampled; minimum distances by coal, the \
clearance is {1000 * part["clearance"]:g} mm:

{table(head, rows)}"""


def collisions_text(part: Part) -> str:
    """Return the paragraphs on stances, steps and plans against MuJoCo and coal."""
    stances, plans = part["stances"], part["plans"]
    checked = [
        ["random stances called free, on random branches of those allowed", stances["free"],
         stances["free_penetrating"]],
        ["random plans, sampled",
         f"{plans['plans']} ({plans['steps']} steps, {plans['configurations']} configurations)",
         plans["penetrating"]],
    ]  # fmt: skip
    return f"""**Collisions.** The MuJoCo scene holds the shapes that the planner checks. \
Clearance {part["clearance"]:g} m.

{table("what | checked | penetrating in MuJoCo", checked)}
Minimum distance of limbs, body and mounts to boxes and between limbs over the free \
stances by coal: {1000 * stances["free_least_distance"]:.2f} mm. Swings of the plans: \
{counted(plans["swings"])}.

**Blocked stances and steps.** {stances["left_out"]} stances meet the thresholds but are ruled out \
by collisions: the best posture of {stances["left_out_nearer_than_clearance"]} of them violates \
the clearance, and that of {stances["left_out_penetrating"]} penetrates in MuJoCo. Of the steps \
between free stances that are possible without collisions, {100 * part["share_blocked"]:.1f} % \
are blocked.

**Allowed collisions**, which are not checked (`mlivr_gym/collisions/allowed_collisions.py`); all \
other pairs are.

{table("shape | with | of | because", [row[:4] for row in ALLOWED_COLLISIONS])}"""


def motions_text(part: Part) -> str:
    """Return the paragraph on the motions of single steps."""
    rows = [
        [robot, f"{row['made']} of {row['steps']}", row["configurations"], row["penetrating"],
         f"{1000 * row['least']:.2f}", f"{1000 * row['slip']:.3f}", f"{max(row['outside'], 0):.0e}",
         f"{row['w_m']:.3f}", f"{row['control']} of {row['made']}"]
        for robot, row in part["robots"].items()
    ]  # fmt: skip
    head = (
        "robot | committed | configurations | penetrating in MuJoCo | minimum distance [mm] | "
        "slip of supports [mm] | outside windows [rad] | minimum w_m of supports | box noticed"
    )
    return f"""**Motions of random steps.** The lines between the knots of committed steps are \
sampled; distances by coal (clearance {1000 * part["clearance"]:g} mm), slip by forward kinematics \
(at most {1000 * part["tolerance"]:g} mm). As a control, a box is put around the limb that moves: \
another motion is chosen, or none.

{table(head, rows)}"""


PARTS: dict[str, Callable[[Part], str]] = {
    "walks": walks_text,
    "execution": execution_text,
    "optimality": optimality_text,
    "limbs": limbs_text,
    "clearance": clearance_text,
    "collisions": collisions_text,
    "motions": motions_text,
}
"""Names of the parts, and the functions that describe them."""

SIZES = {
    "walks": 10_000, "executed": 300, "steps": 2000, "queries": 1000, "maps": 540, "past": 1500,
    "stances": 2000, "free": 500, "plans": 200, "motions": 2000,
}  # fmt: skip
"""Default numbers of random walks, walks and steps carried out, queries of two limbs, small maps,
steps past obstacles, free stances, steps of which it is asked whether they are blocked, plans that
are sampled, and motions."""


def markdown(known: dict[str, Part]) -> str:
    """Return the report."""
    parts = [describe(known[name]) for name, describe in PARTS.items()]
    head = "# Checks against independent programs\n\nMade by `experiments/truth.py`.\n"
    return "\n".join([head, *parts])


def measured(workers: int, **size: int) -> dict[str, Part]:
    """Return the results of all parts."""
    return {
        "walks": study_walks(size["walks"], workers),
        "execution": study_execution(size["executed"], size["steps"], workers),
        "optimality": study_optimality(size["queries"], max(3, size["queries"] // 10)),
        "limbs": study_small_maps(size["maps"], workers),
        "clearance": study_clearance(size["past"], workers),
        "collisions": study_collisions(size["stances"], size["free"], size["plans"]),
        "motions": study_motions(size["motions"], workers),
    }


if __name__ == "__main__":
    experiment("truth", __doc__, measured, markdown, workers=CORES, **SIZES)
