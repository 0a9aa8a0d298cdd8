"""The page of the study of the paper's figures, told from its data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from task_space_swing import OUTCOMES

from mlivr_gym.simulation.phase_torques import CAPTURE, CAPTURE_TIME, PARTS

SWINGS = ("joint space", "task space")
CONTROLLERS = ("PD", "PD and feedforward")
Rows = Sequence[dict[str, Any]]


def runs_of(steps: Rows, swing: str, controller: str) -> list[dict[str, Any]]:
    """What was measured of the steps that both swings can do."""
    both = [row for row in steps if set(SWINGS) <= set(row["runs"])]
    return [row["runs"][swing][controller] for row in both]


def largest_counts(runs: Rows) -> Counter[str]:
    """In how many steps the largest torque lies in each part."""
    return Counter(run["largest_in"] for run in runs)


def peaks(runs: Rows, part: str, what: str = "peak_N_m") -> list[float]:
    """Torques in one part of the steps that have it [N m]."""
    return [run["parts"][part][what] for run in runs if part in run["parts"]]


def per_millimetre(rows: Rows) -> float:
    """Median torque at the capture for each millimetre by which the gripper was off [N m/mm]."""
    return float(
        np.median([row[CAPTURE] / row["capture_distance_mm"][0] for row in rows if CAPTURE in row])
    )


def reproduced(runs: Rows) -> str:
    """Whether the largest torque is at the capture, in one word."""
    share = largest_counts(runs)[CAPTURE] / len(runs)
    return "yes" if share > 0.9 else "no" if share < 0.1 else "in part"


def markdown(data: dict[str, Any]) -> str:
    """The whole page."""
    return "\n".join(
        [
            *verdict_lines(data),
            *phase_lines(data["steps"]),
            *cause_lines(data["causes"]),
            *swing_lines(data["steps"]),
            *case_lines(data),
            *path_lines(data["walks"]),
            "",
            "## Overview",
            "",
            "![The walk of Case 3 in the module](overview.png)",
            "",
            "Made by `experiments/overview.py`, like the paper's first figure.",
            "",
        ]
    )


def verdict_lines(data: dict[str, Any]) -> list[str]:
    """Whether the paper's peaks at contact are reproduced, and what makes the difference."""
    steps, causes = data["steps"], data["causes"]
    counts = {
        (swing, name): largest_counts(runs_of(steps, swing, name))[CAPTURE]
        for swing in SWINGS
        for name in CONTROLLERS
    }
    words = {key: reproduced(runs_of(steps, *key)) for key in counts}
    (ours, ours_fed), (task, task_fed) = (
        [f"{words[swing, name]} ({counts[swing, name]})" for name in CONTROLLERS]
        for swing in SWINGS
    )
    both, beside = len(runs_of(steps, *next(iter(counts)))), "PD, 5 mm beside the point"
    fast, fed = "PD, constant speed", "feedforward, 5 mm beside the point"
    return [
        "# The paper's figures",
        "",
        "Made by `experiments/paper_figures.py`. The paper's figure of torques (RMS over all "
        "joints) has its peaks at contact. Is that so here, with the swing of the plans (lines in",
        "joint space, checked as a whole) and with the paper's (gripper on a straight line, joints "
        "by inverse kinematics on one branch)?",
        "",
        f"Of {len(steps)} steps (Case 3 and {data['plans'] - 1} random plans, 50 s a step) {both} "
        "can be swung both ways. Is the largest torque of a step in the second after its capture?",
        "*Yes* in more than nine steps of ten, *no* in fewer than one; in brackets the number of "
        f"steps, of {both}:",
        "",
        "| swing | the paper's controller (PD) | PD and feedforward |",
        "|---|---|---|",
        f"| joint space, the plan's | {ours} | {ours_fed} |",
        f"| task space, the paper's | {task} | {task_fed} |",
        "",
        "* **The swing's path** decides how high the capture has to be to stand out: with PD the "
        f"swing's peak is {swing_ratio(steps, 'PD'):.1f} times as high (median) on the plan's "
        "lines as in task space,",
        f"  with feedforward {swing_ratio(steps, 'PD and feedforward'):.1f} times. The plan's "
        "lines go round what stands in the way, by a fold where they must.",
        "* **The grasp** decides how high it is: the torque after a capture goes with how far the "
        f"gripper is off its point, {per_millimetre(causes['PD']):.2f} N m a millimetre under PD "
        f"and {per_millimetre(causes[fed]):.2f} where a gripper with",
        f"  feedforward is sent beside its point (medians). Under PD, which lags behind, grippers "
        f"arrive {arrival(causes['PD']):.1f} mm off, with feedforward "
        f"{1e3 * arrival(causes['feedforward']):.0f} um: there is nothing to pull.",
        f"* **Both together** bring the paper's picture about. Sent 5 mm beside its point under "
        f"PD, a gripper's capture has the step's largest torque in {caught(causes[beside])} with "
        f"the plan's swings, in",
        f"  {caught(causes['task space, ' + beside])} in task space. A gripper that comes on at "
        "constant speed and stops at once, in place of a quintic, does it without being off: in "
        f"{caught(causes[fast])} and",
        f"  {caught(causes['task space, ' + fast])}. The paper tells neither how far off its "
        "grippers are nor the clock of its approach, so which of them it was is not known.",
        "",
        "![Torques of Case 3 with both swings](paper_torques.png)",
    ]


def swing_ratio(steps: Rows, controller: str) -> float:
    """Median of how many times as high the swing's peak is in joint space as in task space."""
    ours, task = (peaks(runs_of(steps, swing, controller), "swing") for swing in SWINGS)
    return float(np.median(np.array(ours) / np.array(task)))


def arrival(rows: Rows) -> float:
    """Median distance of gripper and point at the capture [mm]."""
    return float(np.median([d for row in rows for d in row["capture_distance_mm"]]))


def caught(rows: Rows) -> str:
    """In how many of the steps the largest torque is at the capture."""
    return f"{sum(row['largest_in'] == CAPTURE for row in rows)} of {len(rows)} steps"


def phase_lines(steps: Rows) -> list[str]:
    """Torques by phase, both swings and controllers."""
    lines = [
        "",
        "## Torques by phase",
        "",
        "Steps by where their largest torque lies, and torques: median (largest) over the steps "
        "of each one's peak, and median of each one's mean, RMS over all joints [N m]. *Capture*:",
        f"the {CAPTURE_TIME:g} s after it, both limbs holding. Each step is carried out by itself, "
        "from rest, without contacts, so that a swing that would touch something is measured too.",
        "",
        "| swing | controller | part | largest in it | peak, median (largest) | mean, median |",
        "|---|---|---|---|---|---|",
    ]
    for swing in SWINGS:
        for controller in CONTROLLERS:
            runs = runs_of(steps, swing, controller)
            counts = largest_counts(runs)
            for part in PARTS:
                high, mean = peaks(runs, part), peaks(runs, part, "mean_N_m")
                lines.append(
                    f"| {swing} | {controller} | {part} | {counts[part]} of {len(runs)} "
                    f"| {np.median(high):.2g} ({max(high):.2g}) | {np.median(mean):.2g} |"
                )
    missed = {}
    for swing in SWINGS:
        for controller in CONTROLLERS:
            runs = runs_of(steps, swing, controller)
            missed[f"{swing}, {controller}"] = sum(not run["captured"] for run in runs)
    told = "; ".join(f"{name}: {count}" for name, count in missed.items())
    return [*lines, "", f"Grasps missed: {told}."]


def cause_lines(causes: dict[str, Rows]) -> list[str]:
    """What makes torques at the capture."""
    lines = [
        "",
        "## What makes a peak at the capture",
        "",
        "All steps, with the swings of the plans where nothing else is said. *Beside the point*: "
        "the gripper is sent so far along the rail from its point. *Constant speed*: the approach",
        "ends at its full speed. "
        "*No reference of velocity*: the derivative term brakes all motion. *Ratio*: peak after "
        "the capture over peak of the swing. *Taken hold*: grasps neither missed nor lost.",
        "",
        "| arrival | taken hold | gripper off, median [mm] | peak after capture, median (largest) "
        "[N m] | ratio, median | largest at the capture |",
        "|---|---|---|---|---|---|",
    ]
    for name, rows in causes.items():
        held = [row for row in rows if CAPTURE in row and row["failure"] is None]
        ratio = [row[CAPTURE] / row["swing"] for row in held]
        high = [row[CAPTURE] for row in held]
        lines.append(
            f"| {name} | {len(held)} of {len(rows)} | {arrival(held):.2g} "
            f"| {np.median(high):.2g} ({max(high):.2g}) | {np.median(ratio):.2g} | {caught(held)} |"
        )
    return lines


def swing_lines(steps: Rows) -> list[str]:
    """How often a swing in task space can be followed."""
    here = Counter(row["task_space"]["planned_branch"] for row in steps)
    anywhere = Counter(row["task_space"]["any_branch"] for row in steps)
    attempts = sum((Counter(row["task_space"]["attempts"]) for row in steps), Counter[str]())
    same = sum(row["task_space"]["same_branch_after"] for row in steps)
    taken = [row["task_space"]["taken"]["as_planned"] for row in steps if SWINGS[1] in row["runs"]]
    lines = [
        "",
        "## Can a swing in task space be followed?",
        "",
        f"Each of the {len(steps)} steps has up to 16 such swings: on each branch on which the "
        "limb can hold the point it leaves, to both ways round in which a gripper grasps. *Free*:",
        "the clearance is kept all along. *Too close*: it can be followed, but comes closer to "
        "something than the clearance. Else a joint leaves its limits, jumps beside a singularity,",
        "or the branch ends on the line.",
        "",
        "| best outcome | on the plan's branch [steps] | on any branch [steps] | all swings |",
        "|---|---|---|---|",
    ]
    for outcome in OUTCOMES:
        lines.append(f"| {outcome} | {here[outcome]} | {anywhere[outcome]} | {attempts[outcome]} |")
    return [
        *lines,
        "",
        f"A limb that stays on its branch ends on the branch that the plan has after the step in "
        f"{same} of {len(steps)} steps only; in the others the plan would have to be another. "
        f"Torques above are those of the best",
        f"swing of each step, {sum(taken)} of {len(taken)} of them on the plan's branch.",
    ]


def case_lines(data: dict[str, Any]) -> list[str]:
    """Case 3 step by step."""
    lines = [
        "",
        "## Case 3 step by step",
        "",
        "Peaks of departure / swing / approach / capture [N m], the largest in bold.",
        "",
        "| step | plan's swing | task space | controller | joint space | task space |",
        "|---|---|---|---|---|---|",
    ]
    for row in data["steps"]:
        if row["plan"] == 0:
            for controller in CONTROLLERS:
                cells = [
                    parts_told(row["runs"][swing][controller]) if swing in row["runs"] else "-"
                    for swing in SWINGS
                ]
                lines.append(
                    f"| {row['step'] + 1} | {row['swing']} | {row['task_space']['any_branch']} "
                    f"| {controller} | {' | '.join(cells)} |"
                )
    walks = data["walks"]
    told = "; ".join(f"{name}: {', '.join(walk['largest_in'])}" for name, walk in walks.items())
    return [
        *lines,
        "",
        f"Carried out as one walk, where the next step begins at once, largest in: {told}.",
    ]


def parts_told(run: dict[str, Any]) -> str:
    """Peaks in the parts of a step."""
    return " / ".join(
        f"**{found['peak_N_m']:.2g}**" if part == run["largest_in"] else f"{found['peak_N_m']:.2g}"
        for part, found in run["parts"].items()
    )


def path_lines(walks: dict[str, Any]) -> list[str]:
    """Planned against actual paths."""
    names = list(next(iter(walks.values()))["deviation_mm"])
    lines = [
        "",
        "## Planned and actual paths",
        "",
        "![Planned and actual paths of base and grippers](paper_paths.png)",
        "",
        "Distance of actual from planned in Case 3, carried out as one walk, largest (mean) [mm]; "
        "then how far grippers are off when they take hold.",
        "",
        f"| controller | {' | '.join(names)} | at captures |",
        f"|---|{'---|' * (len(names) + 1)}",
    ]
    for controller, walk in walks.items():
        cells = [
            f"{found['peak']:.3g} ({found['mean']:.2g})" for found in walk["deviation_mm"].values()
        ]
        off = ", ".join(f"{distance:.2g}" for distance in walk["capture_distance_mm"])
        lines.append(f"| {controller} | {' | '.join(cells)} | {off} |")
    first, walk = next(iter(walks.items()))
    rows = [
        f"| {k} | {' | '.join(f'{value:.3g}' for value in row)} |"
        for k, row in enumerate(walk["deviation_by_step_mm"], 1)
    ]
    head = [f"| step, {first} | {' | '.join(names)} |", f"|---|{'---|' * len(names)}"]
    return [*lines, "", "Largest in each step [mm]:", "", *head, *rows]


def readme_text(data: dict[str, Any]) -> str:
    """What the page on simulation says of it."""
    steps, causes = data["steps"], data["causes"]
    ours, task = (largest_counts(runs_of(steps, swing, "PD"))[CAPTURE] for swing in SWINGS)
    fed = largest_counts(runs_of(steps, SWINGS[0], CONTROLLERS[1]))[CAPTURE]
    count, beside = len(runs_of(steps, SWINGS[0], "PD")), "task space, PD, 5 mm beside the point"
    return (
        f"The paper's torques peak at contact. Here, under its controller, a step's largest torque "
        f"comes with the capture in {ours} of {count} steps; with swings in task space, as the\n"
        f"paper has them, in {task}, and where the grippers of those are sent 5 mm beside their "
        f"points, in {caught(causes[beside])}. With feedforward it does in {fed}.\n"
        "The [report](../reports/paper_figures.md) tells why, with planned and actual paths and an "
        "overview.\n"
    )
