"""Tables and plots of `planner_vs_rl.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.agents.evaluation import bootstrap
from mlivr_gym.arrays import Array
from mlivr_gym.files import write_whole
from mlivr_gym.pictures.figures import save_figure

NOTHING = "\N{EN DASH}"
"""What a cell without a figure shows."""

NOT_MEASURED, NEVER_REACHED = "not measured", "goal never reached"
"""What stands in the plot where there is no figure."""

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
    "half": (0.95, np.inf),
    "dense": (0.95, np.inf),
    "occupied": (0.95, np.inf),
}
"""Least success and most steps over optimal that were aimed at for the best learned policy."""


class Runs:
    """All runs of one method in one family: seeds by episodes."""

    def __init__(self, data: dict[str, Any]) -> None:
        """Line the parts up."""
        self.seeds = sorted(data)
        self.keys = sorted(
            {(part, t) for seed in data.values() for part, r in seed.items() for t in r["tasks"]}
        )
        index = {key: k for k, key in enumerate(self.keys)}
        shape = (len(self.seeds), len(self.keys))
        names = (
            "success",
            "steps",
            "base_translation",
            "first_decision",
            "decision",
            "carried_out",
            "refined",
        )
        self.values = {name: np.full(shape, np.nan) for name in names}
        for row, seed in enumerate(self.seeds):
            for part, result in data[seed].items():
                for name in names:
                    for task, value in zip(result["tasks"], result.get(name, []), strict=False):
                        self.values[name][row, index[part, task]] = (
                            np.nan if value is None else value
                        )

    def successful(self, name: str) -> Array:
        """A figure where the goal was reached, NaN elsewhere, shape (seeds, episodes)."""
        return np.where(self.values["success"] == 1.0, self.values[name], np.nan)


def ratio(runs: Runs, name: str, best: Runs) -> Array:
    """A figure over that of the best method, by episode, mean over seeds.

    Episodes that the method never solved are not in it.
    """
    row = {key: k for k, key in enumerate(best.keys)}
    reference = np.array(
        [best.successful(name)[0, row[key]] if key in row else np.nan for key in runs.keys]
    )
    share = runs.successful(name) / reference
    known = np.isfinite(share).any(axis=0)
    means: Array = np.nanmean(share[:, known], axis=0)
    return means


def interval(values: Array, digits: int, percent: bool = False) -> str:
    """A mean with its 95 % bootstrap interval."""
    if not len(values):
        return NOTHING
    scale, unit = (100.0, " %") if percent else (1.0, "")
    low, high = bootstrap(values)
    texts = [f"{scale * value:.{digits}f}" for value in (values.mean(), low, high)]
    return f"{texts[0]}{unit} [{texts[1]}, {texts[2]}]"


def relative(runs: Runs, name: str, best: Runs | None, unit: str) -> str:
    """A figure over that of the best method; where there is none, its mean."""
    if best is not None:
        return interval(ratio(runs, name, best), 3)
    return f"{np.nanmean(runs.successful(name)):.2f} {unit}"


def shortened(runs: Runs, best: Runs | None) -> str:
    """Base translation with poses refined on the same footholds, over the least unrefined one."""
    if best is None or not np.isfinite(runs.values["refined"]).any():
        return NOTHING
    row = {key: k for k, key in enumerate(best.keys)}
    least = np.array([best.successful("base_translation")[0, row[key]] for key in runs.keys])
    share = runs.successful("refined") / least
    return interval(np.nanmean(share[:, np.isfinite(share).any(axis=0)], axis=0), 3)


def table_rows(data: dict[str, Any], family: str) -> list[tuple[str, list[str]]]:
    """Method and cells of each row of one family, the cells in the order of `HEAD`."""
    runs = {name: Runs(found) for name, found in data[family].items()}
    steps = runs.get(
        "table-expected"
        if family == "unreliable"
        else "table"
        if "table" in runs
        else "astar-steps"
    )
    base = runs.get("astar-base")
    rows = []
    for name in [n for n in NAMES if n in runs]:
        one = runs[name]
        rate = np.nanmean(one.values["success"], axis=0)
        by_seed = np.nanmean(one.values["success"], axis=1)
        spread = (
            f"{100 * by_seed.min():.0f} to {100 * by_seed.max():.0f} %"
            if len(one.seeds) > 1
            else NOTHING
        )
        tried = one.values["carried_out"][one.values["success"] == 1.0]
        tried = tried[np.isfinite(tried)]
        cells = [
            interval(rate, 1, True),
            spread,
            relative(one, "steps", steps, "steps"),
            relative(one, "base_translation", base, "m"),
            shortened(one, base),
            f"{1e3 * np.nanmedian(one.values['first_decision']):.3g}",
            f"{1e3 * np.nanmedian(one.values['decision']):.3g}",
            f"{100 * tried.mean():.0f} % of {len(tried)}" if len(tried) else "not executed",
        ]
        rows.append((name, cells))
    return rows


HEAD = (
    "| method | success | by seed | steps over optimal | base translation over optimal "
    "| refined | first action [ms] | action [ms] | carried out |\n"
    "|---|---|---|---|---|---|---|---|---|\n"
)


def full_report(data: dict[str, Any]) -> str:
    """The whole report."""
    lines = [
        "# Planners and learned policies",
        "",
        "Made by `experiments/planner_vs_rl.py`. Means with 95 % bootstrap intervals over "
        "tasks; for learned policies the mean over training seeds. Ratios are over the "
        "episodes that reach their goal; optimal is the exact table for the steps, or A* where "
        "there is none, and A* for the translation. *Refined*: the translation over the same "
        "optimum once the base poses on the walk's footholds are optimised; *carried out*: the "
        "share of walks that MuJoCo carries out as fast as the limits allow; both for the "
        "first tasks alone. *First action*: from the reset to the first action, world "
        "included; *action*: the policy alone; medians. On the dense map methods use what "
        "others have found out of its steps before; a fair first action is that with no step "
        "known. A policy stops an episode that asks for a step that is not possible; all stop "
        "after 60 steps.",
        "",
    ]
    lines += ["## What was aimed at", "", aims_table(data)]
    titles = SPLITS | {
        "cold": "First action on the dense map with no step known",
        "unreliable": "Unreliable grasps, same map (optimal: expected cost)",
    }
    for family, title in titles.items():
        if family in data:
            lines += [
                f"## {title[0].upper()}{title[1:]}",
                "",
                HEAD
                + "\n".join(
                    f"| {NAMES[name]} | " + " | ".join(cells) + " |"
                    for name, cells in table_rows(data, family)
                ),
                "",
            ]
    return "\n".join(lines)


def aims_table(data: dict[str, Any]) -> str:
    """What was aimed at, and what the best learned policies reach, alone and with a beam.

    Cells give success and steps over optimal.
    """
    head = (
        "| split | aim | best policy alone | met | best policy with a beam | met |\n"
        "|---|---|---|---|---|---|\n"
    )
    lines = []
    for split, (least, most) in AIMS.items():
        found = {name: Runs(runs) for name, runs in data.get(split, {}).items()}
        best = found.get("table", found.get("astar-steps"))
        if best is None:
            continue
        cells = [
            SPLITS[split],
            f"{100 * least:.0f} %" + (f", {most:.2f}" if np.isfinite(most) else ""),
        ]
        for beam in (False, True):
            names = [
                n for n in found if n.endswith(("pointer-beam",) if beam else ("pointer", "mlp"))
            ]
            reached = {
                n: (float(np.nanmean(found[n].values["success"])), ratio(found[n], "steps", best))
                for n in names
            }
            if not names:
                cells += [NOTHING, NOTHING]
                continue
            name = max(names, key=lambda n: (round(reached[n][0], 3), -reached[n][1].mean()))
            success, steps = reached[name][0], float(reached[name][1].mean())
            cells += [
                f"{NAMES[name]}: {100 * success:.1f} %, {steps:.3f}",
                "yes" if success >= least and steps <= most else "no",
            ]
        lines.append("| " + " | ".join(cells) + " |")
    return head + "\n".join(lines) + "\n"


def readme_table(data: dict[str, Any]) -> str:
    """Success and steps over optimal by split, and the time of the first action."""
    found = {split: dict(table_rows(data, split)) for split in SPLITS if split in data}
    head = (
        "| method | " + " | ".join(SPLITS[s] for s in found) + " | base, same map | action [ms] |\n"
    )
    lines = [head + "|---" * (len(found) + 3) + "|"]
    for name in NAMES:
        if not any(name in rows for rows in found.values()):
            continue
        cells = []
        for rows in found.values():
            if name in rows:
                success, steps = rows[name][0].split(" [")[0], rows[name][2].split(" [")[0]
                cells.append(f"{success}, {steps}" if steps != NOTHING else success)
            else:
                cells.append(NOTHING)
        same = found.get("same", {}).get(name)
        cells += [same[3].split(" [")[0], same[6]] if same else [NOTHING, NOTHING]
        lines.append(f"| {NAMES[name]} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n\n" + aims_table(data)


def draw(data: dict[str, Any], path: Path) -> None:
    """Success and steps over optimal of each method in each split, every mean with its figure.

    The axis of the steps is logarithmic and holds all of them.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    splits = [s for s in SPLITS if s in data]
    names = [
        n for n in NAMES if any(n in data[s] for s in splits) and n not in ("dijkstra", "table")
    ]
    figure = Figure(figsize=(12.0, 1.6 + 0.7 * len(names)), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 2, sharey=True)
    height = 0.8 / len(splits)
    for k, split in enumerate(splits):
        best = next(
            (Runs(data[split][name]) for name in ("table", "astar-steps") if name in data[split]),
            None,
        )
        for place, name in enumerate(names):
            y = place + (k - 0.5 * (len(splits) - 1)) * height
            one = Runs(data[split][name]) if name in data[split] else None
            success = None if one is None else 100.0 * np.nanmean(one.values["success"], axis=0)
            share = None if one is None or best is None else ratio(one, "steps", best)
            _mean(axes[0], y, success, f"C{k}", " %")
            _mean(axes[1], y, share, f"C{k}", "")
    axes[0].set_yticks(range(len(names)), [NAMES[n] for n in names])
    axes[0].invert_yaxis()
    axes[0].set_xlabel("success [%], mean and 95 % interval")
    axes[0].set_xlim(-4.0, 122.0)
    axes[0].set_xticks(range(0, 101, 20))
    axes[1].set_xlabel("steps over optimal where the goal is reached, logarithmic")
    _ratio_axis(axes[1])
    for axis in axes:
        axis.set_axisbelow(True)
        axis.grid(axis="x", color="0.9")
        axis.spines[["top", "right"]].set_visible(False)
        for between in range(1, len(names)):
            axis.axhline(between - 0.5, color="0.85", linewidth=0.6)
    handles = [
        axes[0].plot([], [], "o", color=f"C{k}", label=SPLITS[split])[0]
        for k, split in enumerate(splits)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(splits), fontsize=9)
    save_figure(figure, path)


def _ratio_axis(axis: Any) -> None:
    """Make an axis of ratios to the optimum logarithmic, with room for what stands beside it."""
    axis.set_xscale("log")
    low, high = min(0.95, axis.get_xlim()[0]), max(1.2, axis.get_xlim()[1])
    axis.set_xlim(low, 1.35 * high)
    ticks = [t for t in (0.5, 0.8, 1, 1.2, 1.5, 2, 3, 5, 10, 20, 50) if low <= t <= 1.35 * high]
    axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.axvline(1.0, color="0.5", linewidth=0.8)


def _mean(axis: Any, y: float, values: Array | None, colour: str, unit: str) -> None:
    """A dot at a mean with its 95 % bootstrap interval and its figure, or why there is none."""
    if values is None or not len(values):
        told = NOT_MEASURED if values is None else NEVER_REACHED
        axis.annotate(
            told,
            (0.02, y),
            xycoords=axis.get_yaxis_transform(),
            fontsize=6.5,
            style="italic",
            va="center",
            color="0.45",
        )
        return
    low, high = bootstrap(values)
    mean = float(values.mean())
    axis.plot([low, high], [y, y], color=colour, linewidth=1.2)
    axis.plot([mean], [y], "o", color=colour, markersize=4.5)
    axis.annotate(
        f"{mean:.0f}{unit}" if unit else f"{mean:.2f}",
        (max(mean, high), y),
        (5, 0),
        textcoords="offset points",
        fontsize=6.5,
        va="center",
        color="0.25",
    )


def write_report(data: dict[str, Any], out: Path) -> None:
    """Write the report and the plot."""
    write_whole(out / "planner_vs_rl.md", full_report(data))
    if any(split in data for split in SPLITS):
        draw(data, out / "planner_vs_rl.png")
