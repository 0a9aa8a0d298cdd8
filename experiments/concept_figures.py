"""Draw the figures of `docs/concepts.md` with the package's own code.

    python experiments/concept_figures.py

All show one plan: from `D2a:4 D2b:4` to (6.0, 0.0, 0.42) m with the fewest steps. Writes `stance`,
`step`, `branch`, `manipulability` and `swing` to `docs/figures/` as PNG and SVG.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from reports import GOAL, ROOT, START, two_limb_graph
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics import Angles, all_angles_at, limb_manipulability, pose
from mlivr_gym.motion import PHASES, Plan
from mlivr_gym.motion.joint_path import StepMotion
from mlivr_gym.pictures import save_figure
from mlivr_gym.pictures.figures import point_colours
from mlivr_gym.pictures.map_views import FROM_ABOVE, FROM_THE_SIDE, View, fill_parts, flat_axes
from mlivr_gym.pictures.robot_shapes import Part, pale, robot_parts
from mlivr_gym.planners import Planner
from mlivr_gym.robot import LIMB_COLOURS
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.stances import StanceGraph

OUT = ROOT / "docs" / "figures"
"""Folder of the figures."""

SIDE = list(FROM_THE_SIDE)

BESIDE: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8, "zorder": 8}
"""Style of words next to a place."""

Span = tuple[float, float, float, float]
"""Left, right, lower and upper limit of a view [m]."""


def draw_parts(axes: Any, view: View, parts: list[Part], paleness: float = 0.0) -> None:
    """Draw shapes of a robot in a flat view, pale and with grey edges."""
    drawn = [part._replace(colour=pale(part.colour, paleness)) for part in parts]
    fill_parts(
        axes, view, drawn, edgecolor=pale("0.4", paleness), linewidth=0.4, zorder=3 - paleness
    )


def shown(figure: Figure, place: Span, graph: StanceGraph, view: View, span: Span) -> Any:
    """Return axes with a flat view of a part of the map."""
    axes = flat_axes(figure, place, view)
    axes.scatter(
        *graph.grasp_map.positions[:, view].T, s=3, color=point_colours(graph.grasp_map), zorder=1
    )
    axes.set(xlim=span[:2], ylim=span[2:])
    return axes


def at(motion: StepMotion, k: int) -> tuple[Array, Array, Array]:
    """Return the configuration at sample `k` of a step."""
    return motion.base_positions[k], motion.base_quaternions[k], motion.joint_positions[k]


def gripper_places(graph: StanceGraph, motion: StepMotion, limb: int) -> Array:
    """Return the positions of a gripper's tip along a step, shape (k, 3) [m]."""
    robot, places = graph.robot, []
    for k in range(len(motion.phase)):
        position, turn, joints = at(motion, k)
        flange = link_frames(robot.limb, joints[limb])[6]
        tip = flange[:3, 3] + robot.tool_length * flange[:3, 2]
        mounted = robot.mount_positions[limb] + robot.mount_rotations[limb] @ tip
        places.append(position + Rotation.from_quat(turn, scalar_first=True).apply(mounted))
    return np.array(places)


def manipulability(graph: StanceGraph, q: Array) -> float:
    """Return `w_m` of a limb at joint angles, shape (6,) [rad], by its definition."""
    frames = link_frames(graph.robot.limb, q)[1:]
    origins, axes = frames[:, :3, 3], frames[:, :3, 2]
    jacobian = np.concatenate([np.cross(origins, axes), axes], axis=1).T
    return limb_manipulability(jacobian, graph.robot.characteristic_length)


def angles(graph: StanceGraph, limb: int, position: Array, turn: Array) -> Array:
    """Return joint angles of all branches on which a limb holds its start point, (8, 6) [rad]."""
    base = pose(position, Rotation.from_quat(turn, scalar_first=True).as_matrix())
    flange, out = graph.solver.grasps[graph.indices(START)[limb]]["flange"], Angles.rows(8)
    all_angles_at(graph.solver.shapes.rows, limb, base, flange, out)
    return np.array(out["q"])


def finish(figure: Figure, title: str, name: str) -> None:
    """Write a figure with its title."""
    figure.suptitle(title, x=0.05, ha="left", fontsize=11)
    save_figure(figure, OUT / f"{name}.png")


def stance_figure(graph: StanceGraph, plan: Plan) -> None:
    """Draw the robot in a stance, the points it holds, and those within one step."""
    figure, positions = Figure(figsize=(10.4, 3.6), dpi=110), graph.grasp_map.positions
    steps, base = graph.successors(graph.state(START)), plan.motion.base_positions[0]
    for edge, view in ((0.07, FROM_THE_SIDE), (0.57, FROM_ABOVE)):
        axes = shown(figure, (edge, 0.15, 0.42, 0.68), graph, view, (0.6, 5.4, -1.15, 1.15))
        for limb, colour in enumerate(LIMB_COLOURS[:2]):
            there = positions[np.unique(steps.point[steps.limb == limb])]
            axes.scatter(
                *there[:, view].T, s=26, facecolor="none", edgecolor=colour, linewidth=0.9,
                zorder=4, label=f"limb {limb} can go there next",
            )  # fmt: skip
        draw_parts(axes, view, robot_parts(graph.robot, plan.configuration(0)), 0.25)
        for name, point, colour in zip(START, graph.indices(START), LIMB_COLOURS, strict=False):
            held = positions[point][list(view)]
            axes.scatter(*held, s=70, color=colour, edgecolor="k", zorder=6)
            axes.annotate(name, held, (4, -12 if view == FROM_THE_SIDE else 5), **BESIDE)
        axes.scatter(*base[list(view)], s=34, marker="s", color="k", zorder=6)
        axes.annotate("base", base[list(view)], (6, 6), **BESIDE)
    named = figure.axes[0].get_legend_handles_labels()
    figure.legend(*named, loc="upper right", fontsize=8, frameon=False, ncols=2)
    finish(figure, f"A stance: limb 0 holds {START[0]}, limb 1 holds {START[1]}", "stance")


def step_figure(graph: StanceGraph, plan: Plan) -> None:
    """Draw four moments of a step, from departure to approach."""
    motion, step = plan.joint_path(0).samples(50), plan.steps[0]
    swing = np.flatnonzero(motion.phase == PHASES.index("swing"))
    moments = {
        "holding": 0,
        "swing: the base begins to move": int(swing[len(swing) // 5]),
        "swing: the limb unfolds": int(swing[4 * len(swing) // 5]),
        "holding again": len(motion.phase) - 1,
    }
    tips, figure = gripper_places(graph, motion, step.limb), Figure(figsize=(10.4, 5.0), dpi=110)
    for k, (name, moment) in enumerate(moments.items()):
        place = (0.07 + 0.48 * (k % 2), 0.52 - 0.44 * (k // 2), 0.44, 0.36)
        axes = shown(figure, place, graph, FROM_THE_SIDE, (1.4, 4.6, -1.15, 0.25))
        draw_parts(axes, FROM_THE_SIDE, robot_parts(graph.robot, at(motion, 0)), 0.8)
        draw_parts(axes, FROM_THE_SIDE, robot_parts(graph.robot, at(motion, moment)), 0.1)
        axes.plot(*tips[: moment + 1, SIDE].T, color=LIMB_COLOURS[step.limb], lw=1.4, zorder=6)
        axes.plot(*motion.base_positions[: moment + 1, SIDE].T, color="k", lw=1.6, zorder=6)
        axes.scatter(*motion.base_positions[moment, SIDE], s=24, marker="s", color="k", zorder=6)
        axes.set_title(name, fontsize=8.5, loc="left", color="0.25")
        if k < 2:
            axes.set_xlabel("")
    finish(figure, f"A step: limb {step.limb} goes from {step.from_point} to {step.to_point}, the "
           f"base {step.displacement:.2f} m (black); the other limb holds", "step")  # fmt: skip


def branch_figure(graph: StanceGraph, plan: Plan) -> None:
    """Draw the branches on which a limb can hold one point with the base at rest."""
    position, turn, joints = plan.configuration(0)
    figure = Figure(figsize=(11.6, 4.6), dpi=110)
    for branch, q in enumerate(angles(graph, 0, position, turn)):
        place = (0.04 + 0.242 * (branch % 4), 0.52 - 0.45 * (branch // 4), 0.215, 0.36)
        axes = shown(figure, place, graph, FROM_THE_SIDE, (1.15, 3.2, -1.2, 0.3))
        axes.set(xlabel="", ylabel="")
        name = f"branch {branch}: out of reach"
        if np.isfinite(q).all():
            parts = robot_parts(graph.robot, (position, turn, np.array([q, joints[1]])))
            for limb, paleness in ((False, 0.85), (True, 0.0)):
                some = [part for part in parts if part.name.startswith("limb0") == limb]
                draw_parts(axes, FROM_THE_SIDE, some, paleness)
            chosen = " (the plan's)" if plan.motion.branches[0, 0] == branch else ""
            name = f"branch {branch}: $w_m$ = {manipulability(graph, q):.3f}{chosen}"
        axes.set_title(name, fontsize=8.5, loc="left", color="0.25")
    title = f"Branches: limb 0 holds {START[0]} with the same flange pose each time"
    finish(figure, title, "branch")


def manipulability_figure(graph: StanceGraph, plan: Plan) -> None:
    """Plot `w_m` of both limbs and its minimum over base positions at one stance."""
    position, turn, _ = plan.configuration(0)
    x, z = position[0] + np.linspace(-0.9, 0.9, 73), np.linspace(-0.95, 0.35, 53)
    best = np.zeros((3, len(z), len(x)))
    for limb, row, column in np.ndindex(2, len(z), len(x)):
        found = angles(graph, limb, np.array([x[column], position[1], z[row]]), turn)
        values = [manipulability(graph, q) for q in found if np.isfinite(q).all()]
        best[limb, row, column] = max(values, default=0.0)
    best[2] = best[:2].min(axis=0)
    figure, threshold = Figure(figsize=(11.6, 3.5), dpi=110), graph.limb_threshold
    held = graph.grasp_map.positions[list(graph.indices(START))]
    for k, name in enumerate(("$w_m$ of limb 0", "$w_m$ of limb 1", "the smaller of both")):
        axes = figure.add_axes((0.05 + 0.305 * k, 0.14, 0.27, 0.68))
        levels = axes.contourf(x, z, best[k], levels=np.linspace(0.0, 0.2, 21), cmap="viridis")
        axes.contour(x, z, best[k], levels=[threshold], colors="w", linewidths=1.6)
        axes.scatter(*held[:, SIDE].T, s=30, color="k", zorder=4)
        axes.scatter(*position[SIDE], marker="s", s=34, color="w", edgecolor="k", zorder=5)
        axes.set(aspect="equal", xlim=x[[0, -1]], ylim=(-1.07, z[-1]))
        axes.set_xlabel("x of the base [m]", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.set_title(name, fontsize=9.5, loc="left", color="0.25")
    figure.axes[0].set_ylabel("z of the base [m]", fontsize=8)
    bar = figure.add_axes((0.955, 0.14, 0.012, 0.68))
    figure.colorbar(levels, cax=bar).ax.tick_params(labelsize=8)
    finish(figure, "Manipulability over places of the base, best branch; white line: threshold "
           f"{threshold:g}; square: the base of the stance", "manipulability")  # fmt: skip


def swing_figure(graph: StanceGraph, plan: Plan) -> None:
    """Draw the path of the gripper during a step, and its knots in joint space."""
    step, path = plan.steps[0], plan.joint_path(0)
    motion = path.samples(60)
    tips, swing = gripper_places(graph, motion, step.limb), np.flatnonzero(motion.phase == 1)
    figure = Figure(figsize=(11.2, 4.0), dpi=110)
    place = (0.07, 0.12, 0.43, 0.72)
    axes = shown(figure, place, graph, FROM_THE_SIDE, (1.2, 4.9, -1.2, 0.75))
    for k, there in enumerate(swing[[0, len(swing) // 2, -1]].tolist()):
        parts = robot_parts(graph.robot, at(motion, there))
        some = [part for part in parts if part.name.startswith((f"limb{step.limb}", "body"))]
        draw_parts(axes, FROM_THE_SIDE, some, 0.75 - 0.2 * k)
    axes.plot(*tips[:, SIDE].T, color="#555555", lw=1.8, zorder=6)
    axes.plot(*tips[swing][:, SIDE].T, color=LIMB_COLOURS[step.limb], lw=1.8, zorder=6)
    axes.set_title("the gripper at the start, in the middle and at the end of its swing",
                   fontsize=9.5, loc="left", color="0.25")  # fmt: skip
    right = figure.add_axes((0.57, 0.14, 0.41, 0.68))
    for joint in range(6):
        right.plot(path.sigmas, path.knots[:, step.limb, joint], ".-", ms=4, lw=0.8,
                   label=f"joint {joint + 1}")  # fmt: skip
    for rest in range(1, len(path.segments)):
        right.axvline(rest, color="0.6", lw=0.8, ls=":")
    right.set_xlabel("path parameter; dots are knots, dotted lines points of rest", fontsize=8)
    right.set_ylabel("joint angle [rad]", fontsize=8)
    right.tick_params(labelsize=8)
    right.spines[["top", "right"]].set_visible(False)
    above: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
    right.legend(fontsize=7.5, frameon=False, ncols=6, **above)
    finish(figure, f"The joint path of a step with a swing of kind '{step.swing}': "
           "knots of the limb that moves", "swing")  # fmt: skip


def main() -> None:
    """Draw all figures."""
    graph = two_limb_graph()
    plan = Planner(graph).plan(START, GOAL, "steps").unwrap()
    OUT.mkdir(parents=True, exist_ok=True)
    for draw in (stance_figure, step_figure, branch_figure, manipulability_figure, swing_figure):
        draw(graph, plan)


if __name__ == "__main__":
    main()
