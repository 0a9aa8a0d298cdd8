"""Manipulability and the certificate, drawn for `docs/concepts.md`."""

from __future__ import annotations

from typing import Any

import numpy as np
from certificate_intervals import intervals
from concept_drawing import GREY, OUT, START, angles, draw_points, manipulability, new_figure
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.envs.tasks import sample_task
from mlivr_gym.kinematics.base_path import base_poses
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.regrasp import Regrasp, planned_regrasp
from mlivr_gym.pictures.figures import write_figure
from mlivr_gym.pictures.flat_views import FROM_THE_SIDE
from mlivr_gym.pictures.robot_shapes import LIMB_COLOURS
from mlivr_gym.planners import Planner
from mlivr_gym.stances.pair_graph import PairGraph

SAMPLES, PLANS = 121, 20
"""Places on a base path, and random plans that an example is chosen from."""

COLOURS = {"proved": "#2a9d5c", "halved": "#e8871e", "below": "#222222"}
"""Colours of intervals by what was found of them."""

MEANINGS = {
    "proved": "proved: $w_m$ stays above the floor on all of it",
    "halved": "not decided: halved",
    "below": "below the floor in the middle: the branch is given up",
}
"""What the colours mean."""


def along_the_path(graph: PairGraph, regrasp: Regrasp, limb: int) -> Array:
    """`w_m` of a holding limb on its branches along a base path, shape (8, SAMPLES)."""
    bases = zip(*base_poses(regrasp.base_path, np.linspace(0.0, 1.0, SAMPLES)), strict=True)
    values = np.full((8, SAMPLES), np.nan)
    for k, base in enumerate(bases):
        for branch, q in enumerate(angles(graph, limb, regrasp.before[limb], base)):
            if np.isfinite(q).all():
                values[branch, k] = manipulability(graph, q)
    return values


def nearest_to_the_floor(graph: PairGraph) -> tuple[Regrasp, int, Array]:
    """The step of some plans on which a holding limb comes nearest to the floor.

    With the limb, and its `w_m` on all branches.
    """
    rng, planner, found = np.random.default_rng(0), Planner(graph), []
    for _ in range(PLANS):
        start, goal = sample_task(graph, rng, 0.2)
        plan = planner.plan(graph.ids(start.stance), goal.tolist(), "base").unwrap()
        for index in range(len(plan.steps)):
            regrasp = planned_regrasp(graph, plan, index)
            limb = 1 - regrasp.limb
            values = along_the_path(graph, regrasp, limb)
            found.append((np.nanmin(values[regrasp.branches[limb]]), regrasp, limb, values))
    _, *nearest = min(found, key=lambda entry: entry[0])
    regrasp, limb, values = nearest
    return regrasp, limb, values


def manipulability_figure(graph: PairGraph, plan: Plan) -> None:
    """`w_m` of both limbs and their margin, over places of the base above a stance."""
    position, turn, _ = plan.configuration(0)
    rotation = Rotation.from_quat(turn, scalar_first=True).as_matrix()
    x = position[0] + np.linspace(-0.9, 0.9, 73)
    z = np.linspace(-0.95, 0.35, 53)
    points = graph.indices(START)
    best = np.zeros((2, len(z), len(x)))
    for row, height in enumerate(z):
        for column, along in enumerate(x):
            base = (np.array([along, position[1], height]), rotation)
            for limb in (0, 1):
                found = angles(graph, limb, points[limb], base)
                values = [manipulability(graph, q) for q in found if np.isfinite(q).all()]
                best[limb, row, column] = max(values, default=0.0)
    figure, threshold = new_figure(11.6, 3.5), graph.limb_threshold
    panels = (
        ("$w_m$ of limb 0", best[0]),
        ("$w_m$ of limb 1", best[1]),
        ("the smaller of both", best.min(axis=0)),
    )
    for k, (name, values) in enumerate(panels):
        axes = figure.add_axes((0.05 + 0.305 * k, 0.14, 0.27, 0.68))
        shown = axes.contourf(x, z, values, levels=np.linspace(0.0, 0.2, 21), cmap="viridis")
        axes.contour(x, z, values, levels=[threshold], colors="w", linewidths=1.6)
        draw_points(axes, FROM_THE_SIDE, graph.grasp_map.positions[list(points)], "k", 30)
        axes.scatter(*position[[0, 2]], marker="s", s=34, color="w", edgecolor="k", zorder=5)
        axes.set_aspect("equal")
        axes.set_xlim(x[0], x[-1])
        axes.set_ylim(-1.07, z[-1])
        axes.set_xlabel("x of the base [m]", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.set_title(name, fontsize=9.5, loc="left", color="0.25")
    figure.axes[0].set_ylabel("z of the base [m]", fontsize=8)
    bar = figure.add_axes((0.955, 0.14, 0.012, 0.68))
    figure.colorbar(shown, cax=bar).ax.tick_params(labelsize=8)
    figure.suptitle(
        f"Manipulability over places of the base, best branch; white line: threshold "
        f"{threshold:g}; square: the base of the stance",
        x=0.05, ha="left", fontsize=11,
    )  # fmt: skip
    write_figure(figure, OUT / "manipulability.png")


def certificate_figure(graph: PairGraph) -> None:
    """`w_m` of a holding limb along a base path, and the intervals on which it is proved."""
    regrasp, limb, values = nearest_to_the_floor(graph)
    share, chosen, floor = (
        np.linspace(0.0, 1.0, SAMPLES),
        regrasp.branches[limb],
        graph.settings.path_floor,
    )
    lost = int(np.argmin(np.where(np.isfinite(values[:, -1]), np.inf, np.nanmax(values, axis=1))))
    figure = new_figure(9.6, 5.6)
    axes = figure.add_axes((0.09, 0.55, 0.88, 0.36))
    colours = {chosen: LIMB_COLOURS[limb], lost: "#333333"}
    for branch in sorted(range(len(values)), key=lambda branch: branch in colours):
        name = {
            chosen: f"branch {chosen}, on which limb {limb} holds",
            lost: f"branch {lost}, which ends",
        }
        axes.plot(
            share,
            values[branch],
            color=colours.get(branch, GREY),
            lw=2.0 if branch in colours else 1.0,
            label=name.get(branch),
        )
    axes.axhline(floor, color="k", lw=1.0, ls="--", label=f"floor {floor:g}")
    axes.set_ylim(0, None)
    axes.set_ylabel(f"$w_m$ of limb {limb}", fontsize=9)
    axes.legend(fontsize=8, frameon=False, loc="lower left", ncols=3)
    for k, branch in enumerate((chosen, lost)):
        place = (0.09, 0.37 - 0.255 * k, 0.88, 0.11 + 0.1 * k)
        _draw_intervals(figure.add_axes(place), intervals(graph, regrasp, limb, branch), branch)
    below = figure.axes[-1]
    below.set_xlabel("base path, from the stance before (0) to the stance after (1)", fontsize=9)
    for verdict, meaning in MEANINGS.items():
        below.bar(0, 0, color=COLOURS[verdict], label=meaning)
    below.legend(fontsize=8, frameon=False, loc="lower left")
    for each in figure.axes:
        each.set_xlim(0, 1)
        each.tick_params(labelsize=8)
        each.spines[["top", "right"]].set_visible(False)
    title = "The certificate of a base path: one branch can be kept all along it, another cannot"
    figure.suptitle(title, x=0.09, ha="left", fontsize=11)
    write_figure(figure, OUT / "certificate.png")


def _draw_intervals(axes: Any, looked: list[tuple[float, float, str]], branch: int) -> None:
    """Draw the intervals at which the certificate looked, halves below the wholes."""
    widths = sorted({half for _, half, _ in looked}, reverse=True)
    for middle, half, verdict in looked:
        colour, row = COLOURS[verdict], -widths.index(half)
        axes.barh(row, 2 * half, 0.72, middle - half, color=colour, edgecolor="w", lw=0.5)
    axes.set_ylim(-len(widths) + 0.4, 0.6)
    axes.set_yticks([])
    axes.set_ylabel(f"branch {branch}", fontsize=9)
