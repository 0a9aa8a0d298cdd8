"""The figures of `docs/concepts.md` and `docs/mathematics.md`, drawn with the package's own code.

    python experiments/concept_figures.py

One task is the example of all of them: from `D2a:4 D2b:4` to (6.0, 0.0, 0.42) m.
"""

from __future__ import annotations

import numpy as np
from concept_drawing import (
    GOAL,
    GREY,
    OUT,
    START,
    angles,
    at,
    draw_parts,
    draw_points,
    gripper_places,
    manipulability,
    new_figure,
    view_axes,
)
from concept_labels import label_figure
from concept_plots import certificate_figure, manipulability_figure
from scipy.spatial.transform import Rotation

from mlivr_gym import stance_graph
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.motion.regrasp import PHASES
from mlivr_gym.motion.runs import Run
from mlivr_gym.pictures.figures import write_figure
from mlivr_gym.pictures.flat_views import FROM_ABOVE, FROM_THE_SIDE, NAMES
from mlivr_gym.pictures.robot_shapes import LIMB_COLOURS, robot_parts
from mlivr_gym.planners import Planner
from mlivr_gym.stances.pair_graph import PairGraph


def main() -> None:
    """Draw all figures."""
    graph = stance_graph()
    assert isinstance(graph, PairGraph)
    plan = Planner(graph).plan(START, GOAL, "steps").unwrap()
    OUT.mkdir(parents=True, exist_ok=True)
    stance_figure(graph, plan)
    step_figure(graph, plan)
    branch_figure(graph, plan)
    manipulability_figure(graph, plan)
    certificate_figure(graph)
    swing_figure(graph, plan)
    label_figure(graph)


SPAN = (np.array([0.6, -1.15, -1.15]), np.array([5.4, 1.15, 1.15]))


def stance_figure(graph: PairGraph, plan: Plan) -> None:
    """The robot in a stance, the points it holds, and those that one step can reach."""
    figure, grasp_map = new_figure(10.4, 3.6), graph.grasp_map
    state = graph.state(START)
    steps = graph.successors(state)
    held = grasp_map.positions[list(graph.indices(START))]
    for place, view in ((0.07, FROM_THE_SIDE), (0.57, FROM_ABOVE)):
        axes = view_axes(figure, (place, 0.15, 0.42, 0.68), view, SPAN)
        axes.set_title(NAMES[view], fontsize=9.5, loc="left", color="0.25")
        draw_points(axes, view, grasp_map.positions, GREY, 5)
        for limb in (0, 1):
            points = np.unique(steps.point[steps.limb == limb])
            shown = grasp_map.positions[points]
            axes.scatter(
                *shown[:, view].T, s=26, facecolor="none", edgecolor=LIMB_COLOURS[limb],
                linewidth=0.9, zorder=4, label=f"limb {limb} can go there next",
            )  # fmt: skip
        draw_parts(axes, view, robot_parts(graph.robot, plan.configuration(0)), 0.25)
        for limb, (point, there) in enumerate(zip(START, held, strict=True)):
            axes.scatter(
                *there[list(view)], s=70, color=LIMB_COLOURS[limb], edgecolor="k", zorder=6
            )
            below = (4, -12) if view == FROM_THE_SIDE else (5, 5)
            axes.annotate(
                point, there[list(view)], xytext=below, textcoords="offset points", fontsize=8,
                zorder=7,
            )  # fmt: skip
        base = plan.motion.base_positions[0]
        axes.scatter(*base[list(view)], s=34, marker="s", color="k", zorder=6)
        axes.annotate(
            "base",
            base[list(view)],
            xytext=(6, 6),
            textcoords="offset points",
            fontsize=8,
            zorder=7,
        )
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), loc="upper right", fontsize=8, frameon=False,
        ncols=2,
    )  # fmt: skip
    figure.suptitle(
        "A stance: limb 0 holds D2a:4, limb 1 holds D2b:4", x=0.07, ha="left", fontsize=11
    )
    write_figure(figure, OUT / "stance.png")


def step_figure(graph: PairGraph, plan: Plan) -> None:
    """One step in four moments: it departs, swings while the base moves, and approaches."""
    motion, step = step_motion(graph, plan, 0), plan.steps[0]
    swing = np.flatnonzero(motion.phase == PHASES.index("swing"))
    moments = (
        (0, "holding"),
        (int(swing[len(swing) // 5]), "swing: the base begins to move"),
        (int(swing[4 * len(swing) // 5]), "swing: the limb unfolds"),
        (len(motion.phase) - 1, "holding again"),
    )
    tips, figure = gripper_places(graph, motion, step.limb), new_figure(10.4, 5.0)
    low, high = np.array([1.4, -1.15, -1.15]), np.array([4.6, 1.15, 0.25])
    for k, (moment, name) in enumerate(moments):
        row, column = divmod(k, 2)
        place = (0.07 + 0.48 * column, 0.52 - 0.44 * row, 0.44, 0.36)
        axes = view_axes(figure, place, FROM_THE_SIDE, (low, high))
        draw_points(axes, FROM_THE_SIDE, graph.grasp_map.positions, GREY, 5)
        draw_parts(axes, FROM_THE_SIDE, robot_parts(graph.robot, at(motion, 0)), 0.8)
        draw_parts(axes, FROM_THE_SIDE, robot_parts(graph.robot, at(motion, moment)), 0.1)
        axes.plot(*tips[: moment + 1, [0, 2]].T, color=LIMB_COLOURS[step.limb], lw=1.4, zorder=6)
        axes.plot(*motion.base_positions[: moment + 1, [0, 2]].T, color="k", lw=1.6, zorder=6)
        axes.scatter(*motion.base_positions[moment, [0, 2]], s=24, marker="s", color="k", zorder=6)
        axes.set_title(name, fontsize=8.5, loc="left", color="0.25")
        if column:
            axes.set_ylabel("")
        if not row:
            axes.set_xlabel("")
    figure.suptitle(
        f"A step: limb {step.limb} goes from {step.from_point} to {step.to_point}, the base "
        f"{step.displacement:.2f} m (black); the other limb holds",
        x=0.07, ha="left", fontsize=11,
    )  # fmt: skip
    write_figure(figure, OUT / "step.png")


def branch_figure(graph: PairGraph, plan: Plan) -> None:
    """The branches on which a limb can hold one point while the base stays."""
    position, turn, joints = plan.configuration(0)
    base = (position, Rotation.from_quat(turn, scalar_first=True).as_matrix())
    found = angles(graph, 0, graph.indices(START)[0], base)
    figure = new_figure(11.6, 4.6)
    low, high = np.array([1.15, -1.15, -1.2]), np.array([3.2, 1.15, 0.3])
    for branch, q in enumerate(found):
        row, column = divmod(branch, 4)
        place = (0.04 + 0.242 * column, 0.52 - 0.45 * row, 0.215, 0.36)
        axes = view_axes(figure, place, FROM_THE_SIDE, (low, high))
        axes.set_xlabel("")
        axes.set_ylabel("")
        draw_points(axes, FROM_THE_SIDE, graph.grasp_map.positions, GREY, 5)
        name = f"branch {branch}"
        if np.isfinite(q).all():
            held = joints.copy()
            held[0] = q
            parts = robot_parts(graph.robot, (position, turn, held))
            limb = [part for part in parts if part.name.startswith("limb0")]
            others = [part for part in parts if not part.name.startswith("limb0")]
            draw_parts(axes, FROM_THE_SIDE, others, 0.85)
            draw_parts(axes, FROM_THE_SIDE, limb)
            name += f": $w_m$ = {manipulability(graph, q):.3f}"
            chosen = plan.motion.branches[0, 0] == branch
            name += " (the plan's)" if chosen else ""
        else:
            name += ": out of reach"
        axes.set_title(name, fontsize=8.5, loc="left", color="0.25")
    figure.suptitle(
        f"Branches: limb 0 holds {START[0]} with the same flange pose each time",
        x=0.04, ha="left", fontsize=11,
    )  # fmt: skip
    write_figure(figure, OUT / "branch.png")


def swing_figure(graph: PairGraph, plan: Plan) -> None:
    """The swing of a step: where the gripper goes, and its knots in joint space."""
    step, motion = plan.steps[0], step_motion(graph, plan, 0)
    tips, figure = gripper_places(graph, motion, step.limb), new_figure(11.2, 4.0)
    low, high = np.array([1.2, -1.15, -1.2]), np.array([4.9, 1.15, 0.75])
    axes = view_axes(figure, (0.07, 0.12, 0.43, 0.72), FROM_THE_SIDE, (low, high))
    draw_points(axes, FROM_THE_SIDE, graph.grasp_map.positions, GREY, 5)
    knots = np.array(step.knots)
    swing = np.flatnonzero(motion.phase == PHASES.index("swing"))
    off = np.abs(motion.joint_positions[swing, step.limb][:, None] - knots[:, 1:]).max(axis=2)
    places = swing[off.argmin(axis=0)]
    for k, place in enumerate(places):
        draw_parts(axes, FROM_THE_SIDE, [
            part for part in robot_parts(graph.robot, at(motion, int(place)))
            if part.name.startswith(f"limb{step.limb}") or part.name == "body"
        ], 0.75 - 0.6 * k / len(places))  # fmt: skip
    for phase, colour in zip(
        range(3), ("#555555", LIMB_COLOURS[step.limb], "#555555"), strict=True
    ):
        inside = motion.phase == phase
        axes.plot(*tips[inside][:, [0, 2]].T, color=colour, lw=1.8, zorder=6)
    axes.scatter(*tips[places][:, [0, 2]].T, s=34, color="k", zorder=7)
    for k, place in enumerate(places):
        axes.annotate(
            str(k),
            tips[place, [0, 2]],
            xytext=(5, 4),
            textcoords="offset points",
            fontsize=8,
            zorder=8,
        )
    axes.set_title(
        "the gripper's way, and the limb where it is closest to the knots",
        fontsize=9.5, loc="left", color="0.25",
    )  # fmt: skip
    right = figure.add_axes((0.57, 0.14, 0.41, 0.68))
    run, share = Run(knots, np.array(step.rounded)[1:-1]), np.linspace(0.0, 1.0, 200)
    at_knots, curve = range(len(knots)), run.at(share)
    for joint in range(1, 7):
        (line,) = right.plot(
            np.interp(share, run.ends, at_knots), curve[:, joint], label=f"joint {joint}"
        )
        right.plot(
            at_knots, knots[:, joint], color=line.get_color(), marker="o", ms=4, lw=0.8, ls=":"
        )
    right.set_xticks(
        range(len(knots)), [f"{k}\ns = {s:g}" for k, s in enumerate(knots[:, 0].round(2))]
    )
    right.set_xlabel("knot, and where the base is on its path", fontsize=8)
    right.set_ylabel("joint angle [rad]", fontsize=8)
    right.tick_params(labelsize=8)
    right.spines[["top", "right"]].set_visible(False)
    right.legend(
        fontsize=7.5, frameon=False, ncols=6, loc="lower center", bbox_to_anchor=(0.5, 1.0)
    )
    figure.suptitle(
        f"A swing of kind '{step.swing}': lines between knots, of limb and base together, "
        "and rounded corners",
        x=0.05, ha="left", fontsize=11,
    )  # fmt: skip
    write_figure(figure, OUT / "swing.png")


if __name__ == "__main__":
    main()
