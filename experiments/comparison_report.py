"""Tables and figure of `planner_vs_rl.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from reports import NOTHING, table, with_interval

from mlivr_gym.agents.evaluation import bootstrap
from mlivr_gym.arrays import Array
from mlivr_gym.pictures import save_figure

SPLITS = {
    "same": "same map",
    "half": "half the points",
    "dense": "points every 0.1 m",
    "occupied": "a fifth occupied",
}

NAMES = {
    "table": "exact cost-to-go table",
    "astar-steps": "A*, step cost",
    "astar-base": "A*, base cost",
    "dijkstra": "Dijkstra, step cost",
    "greedy": "greedy best-first",
    "local": "local choice (Bretl, Uno)",
    "no-manipulability": "A* without manipulability (Takada)",
    "no-manipulability-reached": "the same, thresholds not asked for",
    "mcts": "Monte Carlo tree search (Xu)",
    "two-level": "two levels (Rodriguez)",
    "random": "random possible steps",
    "table-sure": "replanning, every grasp counted as sure",
    "table-expected": "replanning, expected cost",
    "dagger-pointer-beam": "DAgger, pointer, beam of 8",
    "dagger-pointer": "DAgger, pointer",
    "bc-pointer": "cloning, pointer",
    "finetune-pointer": "DAgger then PPO, pointer",
    "ppo-pointer": "PPO, pointer",
    "dagger-mlp": "DAgger, MLP",
    "ppo-mlp": "PPO, MLP",
    "risky-pointer-beam": "DAgger with failures, pointer, beam of 8",
    "risky-pointer": "DAgger with failures, pointer",
}
"""Methods in the order of the tables."""


AIMS = {
    "same": (0.99, 1.05),
    **dict.fromkeys(("half", "dense", "occupied"), (0.95, np.inf)),
}
"""Minimum success and maximum ratio of steps that were aimed at for the best learned policy."""


FIGURES = (
    "success", "steps", "base_translation", "first_decision", "decision", "carried_out", "refined"
)  # fmt: skip
"""Values of each episode."""


class Runs:
    """All runs of one method in one family: seeds by episodes."""

    def __init__(self, data: dict[str, Any]) -> None:
        """Align the parts by episode."""
        seeds = [data[seed] for seed in sorted(data)]
        self.keys = sorted(
            {(part, t) for seed in seeds for part in seed for t in seed[part]["tasks"]}
        )
        index = {key: k for k, key in enumerate(self.keys)}
        self.values = {name: np.full((len(seeds), len(index)), np.nan) for name in FIGURES}
        for row, seed in enumerate(seeds):
            for part, found in seed.items():
                for name in set(FIGURES) & set(found):
                    for task, value in zip(found["tasks"], found[name], strict=False):
                        known = np.nan if value is None else value
                        self.values[name][row, index[part, task]] = known

    def successful(self, name: str) -> Array:
        """Return a value where the goal was reached, NaN elsewhere, shape (seeds, episodes)."""
        return np.where(self.values["success"] == 1.0, self.values[name], np.nan)


def ratio(runs: Runs, name: str, best: Runs, reference: str | None = None) -> Array:
    """Return a value over that of the best method, by episode, mean over seeds.

    Episodes that the method never solved are left out. `reference` is the name of the best method's
    value if it differs.
    """
    known = dict(zip(best.keys, best.successful(reference or name)[0], strict=True))
    share = runs.successful(name) / np.array([known.get(key, np.nan) for key in runs.keys])
    means: Array = np.nanmean(share[:, np.isfinite(share).any(axis=0)], axis=0)
    return means


def interval(values: Array, digits: int, percent: bool = False) -> str:
    """Return a mean with its 95 % bootstrap interval."""
    if not len(values):
        return NOTHING
    return with_interval(values.mean(), bootstrap(values), digits, percent)


def relative(runs: Runs, name: str, best: Runs | None, unit: str) -> str:
    """Return a value over that of the best method, or its mean if `best` is None."""
    if best is not None:
        return interval(ratio(runs, name, best), 3)
    return f"{np.nanmean(runs.successful(name)):.2f} {unit}"


def best_steps(runs: dict[str, Runs], family: str) -> Runs | None:
    """Return the runs with the optimal number of steps in a family."""
    names = ("table-expected",) if family == "unreliable" else ("table", "astar-steps")
    return next((runs[name] for name in names if name in runs), None)


def table_rows(data: dict[str, Any], family: str) -> list[tuple[str, list[str]]]:
    """Return method and cells of each row of one family; the cells are in the order of `HEAD`."""
    runs = {name: Runs(found) for name, found in data[family].items()}
    steps, base, rows = best_steps(runs, family), runs.get("astar-base"), []
    for name in [n for n in NAMES if n in runs]:
        one = runs[name]
        success, walks = one.values["success"], one.successful("carried_out")
        tried, refined = walks[np.isfinite(walks)], np.isfinite(one.values["refined"]).any()
        by_seed = 100.0 * np.nanmean(success, axis=1)
        cells = [
            interval(np.nanmean(success, axis=0), 1, True),
            f"{by_seed.min():.0f} to {by_seed.max():.0f} %" if len(success) > 1 else NOTHING,
            relative(one, "steps", steps, "steps"),
            relative(one, "base_translation", base, "m"),
            interval(ratio(one, "refined", base, "base_translation"), 3)
            if base is not None and refined
            else NOTHING,
            f"{1e3 * np.nanmedian(one.values['first_decision']):.3g}",
            f"{1e3 * np.nanmedian(one.values['decision']):.3g}",
            f"{100 * tried.mean():.0f} % of {len(tried)}" if len(tried) else "not executed",
        ]
        rows.append((name, cells))
    return rows


HEAD = (
    "method | success | by seed | steps over optimal | base translation over optimal | "
    "refined | first action [ms] | action [ms] | carried out"
)


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    titles = SPLITS | {
        "cold": "First action on the dense map with no step known",
        "unreliable": "Unreliable grasps, same map (optimal: expected cost)",
    }
    sections = [
        f"## {title[0].upper()}{title[1:]}\n\n"
        + table(HEAD, ([NAMES[name], *cells] for name, cells in table_rows(data, family)))
        for family, title in titles.items()
        if family in data
    ]
    return f"""# Planners and learned policies

Made by `experiments/planner_vs_rl.py`. Means with 95 % bootstrap intervals over tasks; for \
learned policies over the mean of the training seeds. Ratios are over the episodes that reach \
their goal; the optimum is that of the exact table for the steps, or of A* if no table exists, and \
of A* for the translation. *Refined*: base translation over the same optimum after the base poses \
at the walk's footholds are optimised; *carried out*: share of walks that succeed in MuJoCo at the \
fastest pace; both only for the first tasks. *First action*: median time from the reset to the \
first action, including checks of the world; *action*: median time of the policy alone. On the \
dense map, methods use the results of step checks of earlier methods; the fair first action is the \
one with no step known. An episode ends when a policy takes an invalid action, and after 60 steps.

## Aims

{aims_table(data)}
{chr(10).join(sections)}"""


def aims_table(data: dict[str, Any]) -> str:
    """Return aims and results (success, steps over optimal) of the best learned policies."""
    rows = []
    for split, (least, most) in AIMS.items():
        found = {name: Runs(runs) for name, runs in data.get(split, {}).items()}
        best = best_steps(found, split)
        if best is None:
            continue
        aim = f"{100 * least:.0f} %" + (f", {most:.2f}" if np.isfinite(most) else "")
        row = [SPLITS[split], aim]
        for ends in (("pointer", "mlp"), ("pointer-beam",)):
            reached = [
                (float(np.nanmean(one.values["success"])), float(ratio(one, "steps", best).mean()),
                 NAMES[name])
                for name, one in found.items() if name.endswith(ends)
            ]  # fmt: skip
            if not reached:
                row += [NOTHING, NOTHING]
                continue
            success, steps, name = max(reached, key=lambda one: (round(one[0], 3), -one[1]))
            met = success >= least and steps <= most
            row += [f"{name}: {100 * success:.1f} %, {steps:.3f}", "yes" if met else "no"]
        rows.append(row)
    return table("split | aim | best policy alone | met | best policy with a beam | met", rows)


def readme_table(data: dict[str, Any]) -> str:
    """Return success and steps over optimal by split, and the time of the first action."""
    found = {split: dict(table_rows(data, split)) for split in SPLITS if split in data}

    def cell(cells: list[str] | None) -> str:
        if cells is None:
            return NOTHING
        success, steps = (cells[k].split(" [")[0] for k in (0, 2))
        return success if steps == NOTHING else f"{success}, {steps}"

    rows = []
    for name in NAMES:
        if any(name in split for split in found.values()):
            same = found.get("same", {}).get(name)
            last = [same[3].split(" [")[0], same[6]] if same else [NOTHING, NOTHING]
            rows.append([NAMES[name], *(cell(split.get(name)) for split in found.values()), *last])
    head = " | ".join(["method", *(SPLITS[split] for split in found), "base, same map",
                       "action [ms]"])  # fmt: skip
    return table(head, rows) + "\n" + aims_table(data)


def figure(data: dict[str, Any], path: Path) -> None:
    """Plot success and (logarithmic) steps over optimal of each method in each split."""
    splits = [s for s in SPLITS if s in data]
    names = [
        n for n in NAMES if any(n in data[s] for s in splits) and n not in ("dijkstra", "table")
    ]
    fig = Figure(figsize=(12.0, 1.6 + 0.7 * len(names)), dpi=110, layout="constrained")
    axes = fig.subplots(1, 2, sharey=True)
    for k, split in enumerate(splits):
        found = {name: Runs(runs) for name, runs in data[split].items()}
        best = best_steps(found, split)
        for place, name in enumerate(names):
            y = place + 0.8 * (k - 0.5 * (len(splits) - 1)) / len(splits)
            one = found.get(name)
            success = None if one is None else 100.0 * np.nanmean(one.values["success"], axis=0)
            share = None if one is None or best is None else ratio(one, "steps", best)
            _mean(axes[0], y, success, f"C{k}", "{:.0f} %")
            _mean(axes[1], y, share, f"C{k}", "{:.2f}")
        axes[0].plot([], [], "o", color=f"C{k}", label=SPLITS[split])
    axes[0].set_yticks(range(len(names)), [NAMES[n] for n in names])
    axes[0].invert_yaxis()
    axes[0].set(xlabel="success [%], mean and 95 % interval", xlim=(-4.0, 122.0))
    axes[0].set_xticks(range(0, 101, 20))
    axes[1].set_xlabel("steps over optimal where the goal is reached, logarithmic")
    _ratio_axis(axes[1])
    for axis in axes:
        axis.set_axisbelow(True)
        axis.grid(axis="x", color="0.9")
        axis.spines[["top", "right"]].set_visible(False)
        for between in range(1, len(names)):
            axis.axhline(between - 0.5, color="0.85", linewidth=0.6)
    handles = axes[0].get_legend_handles_labels()
    fig.legend(*handles, loc="outside upper center", ncols=len(splits), fontsize=9)
    save_figure(fig, path)


def _ratio_axis(axis: Any) -> None:
    """Make an axis of ratios logarithmic, with space for words next to the points."""
    axis.set_xscale("log")
    low, high = min(0.95, axis.get_xlim()[0]), max(1.2, axis.get_xlim()[1])
    axis.set_xlim(low, 1.35 * high)
    ticks = [t for t in (0.5, 0.8, 1, 1.2, 1.5, 2, 3, 5, 10, 20, 50) if low <= t <= 1.35 * high]
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.axvline(1.0, color="0.5", linewidth=0.8)


def _mean(axis: Any, y: float, values: Array | None, colour: str, form: str) -> None:
    """Draw a mean with its 95 % bootstrap interval and its value, or why it is missing."""
    style: dict[str, Any] = {"fontsize": 6.5, "va": "center"}
    if values is None or not len(values):
        words = "not measured" if values is None else "goal never reached"
        axis.annotate(words, (0.02, y), xycoords=axis.get_yaxis_transform(), style="italic",
                      color="0.45", **style)  # fmt: skip
        return
    (low, high), mean = bootstrap(values), float(values.mean())
    axis.plot([low, high], [y, y], color=colour, linewidth=1.2)
    axis.plot([mean], [y], "o", color=colour, markersize=4.5)
    axis.annotate(form.format(mean), (max(mean, high), y), (5, 0), textcoords="offset points",
                  color="0.25", **style)  # fmt: skip
