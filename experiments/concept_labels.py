"""Draw labels along a walk, their lower bounds and a dominated label for `docs/mathematics.md`.

    python experiments/concept_labels.py

Writes `docs/figures/labels.svg`, which is shown, and `.png`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from concept_figures import OUT
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from reports import GOAL, START, two_limb_graph

from mlivr_gym.arrays import Array
from mlivr_gym.extensions.viewer import states_of
from mlivr_gym.pictures import save_figure
from mlivr_gym.planners import GOAL_TOLERANCE, Goal, Planner
from mlivr_gym.planners.searches import GraphSearcher
from mlivr_gym.robot import LIMB_COLOURS
from mlivr_gym.stances import StanceGraph, State

NONE, HOLDS, ON = "#ffffff", "#d9d9d9", "#1d3557"
"""Colours of a branch on which a limb cannot hold, can hold, and can be after the walk."""


def label_figure(graph: StanceGraph) -> None:
    """Draw label, cost and bound after each step of a base-cost plan, and a dominated label."""
    plan = Planner(graph).plan(START, GOAL, "base").unwrap()
    states = [state for state in states_of(graph, plan) if state is not None]
    figure = Figure(figsize=(12.4, 5.6), dpi=110)
    for k, state in enumerate(states):
        x = 0.055 + 0.119 * k
        for limb in range(2):
            axes = figure.add_axes((x, 0.745 - 0.15 * limb, 0.098, 0.075))
            draw_label(
                axes,
                state.branch_sets[limb],
                int(graph.branch_sets[graph.find(state.stance), limb]),
            )
            axes.set_title(
                graph.ids(state.stance)[limb], fontsize=8, pad=3, color=LIMB_COLOURS[limb],
                fontweight="bold" if k and limb == plan.steps[k - 1].limb else "normal",
            )  # fmt: skip
            if not k:
                axes.set_ylabel(f"limb {limb}", fontsize=8, color=LIMB_COLOURS[limb])
        if k:
            limb = plan.steps[k - 1].limb
            figure.text(
                x - 0.0105, 0.885, f"limb {limb}\n→", fontsize=8, ha="center",
                color=LIMB_COLOURS[limb],
            )  # fmt: skip
        figure.text(x + 0.049, 0.9, f"$x_{k}$", fontsize=11, ha="center")
    figure.text(
        0.055, 0.505, "8 branches by 2 flips. Grey: on which the limb may hold, $M_i(s)$. "
        "Dark: the label, on which it may be after this walk, $L_i$. Bold: the limb that moved.",
        fontsize=8.5, color="0.3",
    )  # fmt: skip
    draw_costs(figure.add_axes((0.055, 0.1, 0.52, 0.36)), costs_along(graph, states))
    draw_dominance(figure, graph)
    figure.suptitle(
        "A walk of two limbs: states $x_k = (s_k, L^k)$", x=0.055, y=0.985, ha="left", fontsize=11
    )
    save_figure(figure, OUT / "labels.png")


def costs_along(graph: StanceGraph, states: list[State]) -> tuple[Array, Array, Array]:
    """Return cost so far and two lower bounds of the remaining cost at each state, (k,) [m].

    The first bound is computed over the node table, the second is the distance to the goal region.
    """
    rows = np.array([graph.find(state.stance) for state in states])
    goal = Goal.from_arguments(graph, GOAL, "base", None, GOAL_TOLERANCE)
    lower_bounds = GraphSearcher(graph).lower_bounds()
    assert lower_bounds is not None
    shift = np.linalg.norm(np.diff(graph.base_position[rows], axis=0), axis=1)
    straight = np.maximum(goal.distance(graph.base_position[rows]) - goal.tolerance, 0.0)
    return (
        np.concatenate([[0.0], np.cumsum(shift)]),
        lower_bounds.compute(goal, rows).h[rows],
        straight,
    )


def draw_label(axes: Any, branches: int, held: int) -> None:
    """Draw a branch set among the branches on which a limb can hold."""
    for bit in range(16):
        colour = ON if branches >> bit & 1 else HOLDS if held >> bit & 1 else NONE
        place = bit % 8, bit // 8
        axes.add_patch(Rectangle(place, 1, 1, facecolor=colour, edgecolor="0.6", linewidth=0.4))
    axes.set_xlim(0, 8)
    axes.set_ylim(2, 0)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.spines[:].set_linewidth(0.6)


def draw_costs(axes: Any, costs: tuple[Array, Array, Array]) -> None:
    """Draw cost so far and lower bounds at each state, stacked."""
    spent, bound, straight = costs
    places = np.arange(len(spent))
    axes.bar(places, spent, 0.62, color="#2b8a3e", label="$g$, the cost so far")
    axes.bar(places, bound, 0.62, spent, color="#b7e4c7", label="$h$ over the table")
    axes.plot(
        places, spent + straight, color="#e8871e", marker="o", ms=4, lw=1.0,
        label="$g + h$ with $h$ by distance",
    )  # fmt: skip
    axes.axhline(spent[-1], color="k", lw=1.0, ls="--", label="$C^*$, the least cost")
    axes.set_xticks(places, [f"$x_{k}$" for k in places])
    axes.set_ylabel("[m]", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.set_ylim(0, 1.32 * spent[-1])
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=8, frameon=False, ncols=4, loc="upper left")


def dominated_pair(graph: StanceGraph) -> tuple[State, float, State, float]:
    """Return two states of a stance after two steps with their costs [m]; the first dominates.

    Of all such pairs it has the labels that differ most, and among these the lowest cost.
    """
    start, found = graph.state(START), {}
    steps, here = graph.successors(start), graph.posture_of(start).base_position[0]
    for k in range(len(steps.limb)):
        between, place = steps.after(start, k), steps.base_position[k]
        more = graph.successors(between)
        costs = np.linalg.norm(more.base_position - place, axis=1) + np.linalg.norm(place - here)
        for n, cost in enumerate(costs.tolist()):
            after = more.after(between, n)
            if after.stance != start.stance:
                found.setdefault(after.stance, []).append((cost, after))
    best: tuple[int, float, Any] = (0, 0.0, None)
    for stance in sorted(found):
        cost, state = min(found[stance], key=lambda one: (one[0], -_size(one[1])))
        for other, label in found[stance]:
            inside = all(
                b & ~a == 0 for a, b in zip(state.branch_sets, label.branch_sets, strict=True)
            )
            score = _size(state) - _size(label), -other
            if inside and score > best[:2]:
                best = (*score, (state, cost, label, other))
    assert best[2] is not None
    pair: tuple[State, float, State, float] = best[2]
    return pair


def _size(state: State) -> int:
    """Return the number of branches in a label."""
    return sum(one.bit_count() for one in state.branch_sets)


def draw_dominance(figure: Any, graph: StanceGraph) -> None:
    """Draw two labels of a stance, the first of which dominates the second."""
    state, cost, other, more = dominated_pair(graph)
    s, names = graph.find(state.stance), graph.ids(state.stance)
    figure.text(0.635, 0.435, f"Dominance, at the stance {' '.join(names)} after two steps",
                fontsize=9.5)  # fmt: skip
    for k, (label, spent, sign) in enumerate(((state, cost, "(L, g)"), (other, more, "(L', g')"))):
        top = 0.295 - 0.165 * k
        figure.text(0.635, top + 0.028, f"${sign}$\n{spent:.2f} m", fontsize=9)
        for limb in range(2):
            axes = figure.add_axes((0.705 + 0.125 * limb, top, 0.098, 0.075))
            draw_label(axes, label.branch_sets[limb], int(graph.branch_sets[s, limb]))
            axes.set_title(f"limb {limb}", fontsize=8, pad=3, color=LIMB_COLOURS[limb])
    figure.text(
        0.635, 0.075, "$L' \\subseteq L$ and $g \\leq g'$: what goes on from the second goes on\n"
        "from the first, too, at no more cost: the second is dropped.",
        fontsize=8.5, color="0.3", va="top",
    )  # fmt: skip


if __name__ == "__main__":
    label_figure(two_limb_graph())
