"""Figure of a walk among obstacles on which the robot planned anew several times."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import (
    add_heading,
    add_legend,
    box_corners,
    box_faces,
    draw_base_path,
    draw_goal,
    save_figure,
)
from mlivr_gym.pictures.flat_views import (
    VIEW_DIRECTIONS,
    View,
    draw_flat_goal,
    draw_flat_path,
    map_views,
    number_stances,
)
from mlivr_gym.pictures.robot_shapes import outline
from mlivr_gym.pictures.route import base_paths
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

PLAN_COLOURS = ("#9c36b5", "#e8590c", "#0b7285", "#862e9c", "#5c940d")
"""Colours of the abandoned parts of plans, in order; none is the colour of a base path."""

OCCUPIED_COLOUR, BOX_COLOUR = "#d00000", "#a5785a"
"""Colours of occupied points and of obstacles."""


class WalkedPlan(NamedTuple):
    """A plan of which the first steps were executed before it was abandoned."""

    plan: Plan
    """The plan."""
    steps_taken: int
    """Number of steps that were executed."""

    @property
    def walked_path(self) -> Array:
        """Base positions along the executed steps, shape (k, 3) [m]."""
        start = self.plan.motion.base_positions[:1]
        return np.concatenate([start, *base_paths(self.plan)[: self.steps_taken]])

    @property
    def abandoned_path(self) -> Array:
        """Base positions along the remaining steps, shape (k, 3) [m]."""
        here = self.plan.motion.base_positions[self.steps_taken : self.steps_taken + 1]
        return np.concatenate([here, *base_paths(self.plan)[self.steps_taken :]])


class WalkedPath(NamedTuple):
    """Base path of a walk that follows several plans."""

    line: Array
    """Base positions along the walk, shape (k, 3) [m]."""
    stances: Array
    """Base positions of its stances, shape (s, 3) [m]."""
    replans: Array
    """Base positions at which a plan was abandoned, shape (b, 3) [m]."""

    @classmethod
    def of(cls, walked_plans: Sequence[WalkedPlan]) -> WalkedPath:
        """Return the walk that follows the plans in order."""
        bases = [
            walked.plan.motion.base_positions[: walked.steps_taken + 1] for walked in walked_plans
        ]
        return cls(
            np.concatenate([walked.walked_path for walked in walked_plans]),
            np.concatenate([bases[0][:1], *(base[1:] for base in bases)]),
            np.array([base[-1] for base in bases[:-1]]).reshape(-1, 3),
        )

    @property
    def length(self) -> float:
        """Sum of the base displacements between stances [m]."""
        return float(np.linalg.norm(np.diff(self.stances, axis=0), axis=1).sum())


def walk_figure(grasp_map: GraspMap, walked_plans: Sequence[WalkedPlan], path: str | Path) -> None:
    """Draw a walk among obstacles in space, from above and from the side, as PNG and SVG.

    The executed path is thick and green; the abandoned part of each plan is dashed, in a separate
    colour. Goal, obstacles and occupied points are those of the last plan.
    """
    walk, last = WalkedPath.of(walked_plans), walked_plans[-1].plan
    figure, axes, flats = map_views(grasp_map)
    for box in last.world.obstacles:
        _draw_obstacle(axes, box)
    occupied = grasp_map.positions[[grasp_map.index(point) for point in last.world.occupied]]
    style = {"color": OCCUPIED_COLOUR, "marker": "x", "zorder": 6}
    axes.scatter(*occupied.T, s=50, depthshade=False, label="points occupied", **style)
    for k, walked in enumerate(walked_plans[:-1]):
        axes.plot(
            *walked.abandoned_path.T, label=f"plan {k + 1}, abandoned", zorder=4, **_dashed(k)
        )
    draw_base_path(axes, walk.line, walk.stances, "base path walked")
    axes.scatter(*walk.replans.T, depthshade=False, label="plan abandoned here", **_BREAK)
    draw_goal(axes, last.query.goal, last.query.goal_tolerance)
    number_stances(axes, walk.stances)
    for view, flat in flats.items():
        _draw_flat(flat, view, walk, walked_plans)
        flat.scatter(*occupied[:, view].T, s=26, **style)
    times = {1: "", 2: " interrupted once", 3: " interrupted twice"}
    many = f" interrupted {len(walked_plans) - 1} times"
    add_heading(figure, f"A walk{times.get(len(walked_plans), many)}", _remark(walk, last))
    add_legend(figure)
    save_figure(figure, path)


_BREAK = {"s": 130, "marker": "o", "facecolor": "none", "edgecolor": "black", "zorder": 7}


def _dashed(k: int) -> dict[str, Any]:
    """Return the line style of the abandoned part of plan k."""
    return {
        "color": PLAN_COLOURS[k % len(PLAN_COLOURS)],
        "linestyle": ("--", "-.", ":")[k % 3],
        "linewidth": 1.8,
    }


def _remark(walk: WalkedPath, plan: Plan) -> str:
    """Return a summary of the walk, with the smallest distance of its base from the obstacles."""
    steps = f"{len(walk.stances) - 1} steps, base translation {walk.length:.2f} m"
    if not plan.world.obstacles:
        return steps
    distance = min(least_distance(walk.line, box) for box in plan.world.obstacles)
    return f"{steps}; the middle of the base passes the box at {distance:.2f} m"


def least_distance(line: Array, box: Box) -> float:
    """Compute the distance of a polyline, shape (k, 3), from a box [m]; 0 if it intersects it."""
    local = np.abs((_sampled(line) - np.array(box.centre)) @ np.array(box.rotation))
    outside: Array = np.maximum(local - np.array(box.half), 0.0)
    return float(np.linalg.norm(outside, axis=1).min())


def _sampled(line: Array) -> Array:
    """Sample a polyline densely, shape (k, 3) [m]."""
    share = np.linspace(0.0, 1.0, 101)[:, None, None]
    positions: Array = ((1.0 - share) * line[:-1] + share * line[1:]).reshape(-1, 3)
    return positions


def _draw_flat(axes: Any, view: View, walk: WalkedPath, walked_plans: Sequence[WalkedPlan]) -> None:
    """Draw the walk in a flat view; boxes cover the path if they are closer to the viewer."""
    goal = walked_plans[-1].plan.query
    for k, walked in enumerate(walked_plans[:-1]):
        axes.plot(*walked.abandoned_path[:, view].T, zorder=2, **_dashed(k))
    draw_flat_path(axes, view, walk.line, walk.stances)
    axes.scatter(*walk.replans[:, view].T, **_BREAK)
    draw_flat_goal(axes, view, goal.goal, goal.goal_tolerance)
    for box in walked_plans[-1].plan.world.obstacles:
        edge = outline(box_faces(box), np.eye(3)[list(view)])
        over = 3.5 if is_in_front(box, walk.line, view) else 1.5
        axes.fill(*edge.T, facecolor=BOX_COLOUR, edgecolor=BOX_COLOUR, alpha=0.55, zorder=over)


def is_in_front(box: Box, line: Array, view: View) -> bool:
    """Return whether a box hides more than half of the part of a polyline that crosses it."""
    positions, (low, high) = _sampled(line), box.bounds
    axes, toward = list(view), np.array(VIEW_DIRECTIONS[view])
    across = ((positions > low) & (positions < high))[:, axes].all(axis=1)
    depth = (positions[across] - np.array(box.centre)) @ toward
    return bool(len(depth)) and float(np.median(depth)) < 0.0


def _draw_obstacle(axes: Any, box: Box) -> None:
    """Draw an obstacle with its id."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    style = {"facecolor": BOX_COLOUR, "edgecolor": BOX_COLOUR, "alpha": 0.35, "zorder": 3}
    axes.add_collection3d(Poly3DCollection(box_faces(box), **style))
    top = box_corners(box).max(axis=0)
    axes.text(*top, box.id, fontsize=9, color=BOX_COLOUR, zorder=8, parse_math=False)
