"""What the figures of `docs/concepts.md` are drawn with: flat views, and a limb's branches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.kinematics.families import forward_kinematics
from mlivr_gym.kinematics.limb import Angles, all_angles_at
from mlivr_gym.kinematics.manipulability import limb_manipulability
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.motion.plan_motion import StepMotion
from mlivr_gym.pictures.flat_views import TOWARD_THE_EYE, View
from mlivr_gym.pictures.robot_shapes import Part, outline, pale
from mlivr_gym.stances.pair_graph import PairGraph

OUT = Path(__file__).parent.parent / "docs" / "figures"
"""Where the figures go."""

START, GOAL = ("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)
"""The task whose plan is the example."""

GREY = "#b8b8b8"
"""Colour of points."""


def new_figure(width: float, height: float) -> Any:
    """An empty figure of a size [inch]."""
    figure = Figure(figsize=(width, height), dpi=110)
    FigureCanvasAgg(figure)
    return figure


def draw_parts(axes: Any, view: View, parts: list[Part], paleness: float = 0.0) -> None:
    """Draw shapes of a robot flat, the farther ones first."""
    toward = np.array(TOWARD_THE_EYE[view])
    for part in sorted(parts, key=lambda part: float(part.faces.mean(axis=(0, 1)) @ toward)):
        edge = outline(part.faces, np.eye(3)[list(view)])
        colour = pale(part.colour, paleness)
        axes.fill(*edge.T, facecolor=colour, edgecolor="white", linewidth=0.4, zorder=3 - paleness)


def view_axes(figure: Any, place: tuple[float, ...], view: View, span: tuple[Array, Array]) -> Any:
    """Axes of a flat view between two corners [m], in true scale."""
    axes = figure.add_axes(place)
    low, high = span
    axes.set_xlim(low[view[0]], high[view[0]])
    axes.set_ylim(low[view[1]], high[view[1]])
    axes.set_aspect("equal")
    axes.set_xlabel("xyz"[view[0]] + " [m]", fontsize=8)
    axes.set_ylabel("xyz"[view[1]] + " [m]", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def draw_points(axes: Any, view: View, points: Array, colour: str, size: float = 9.0) -> None:
    """Draw points, shape (k, 3) [m]."""
    axes.scatter(*points[:, view].T, s=size, color=colour, linewidth=0, zorder=4)


def at(motion: StepMotion, k: int) -> tuple[Array, Array, Array]:
    """The configuration at a place along a step."""
    return motion.base_positions[k], motion.base_quaternions[k], motion.joint_positions[k]


def gripper_places(graph: PairGraph, motion: StepMotion, limb: int) -> Array:
    """Where the tip of a limb's gripper is along a step, shape (k, 3) [m]."""
    robot, places = graph.robot, []
    for k in range(len(motion.phase)):
        position, turn, joints = at(motion, k)
        base = Rotation.from_quat(turn, scalar_first=True).as_matrix()
        flange = forward_kinematics(joints[limb], robot.limb.lengths)[6]
        tip = flange[:3, 3] + robot.tool_length * flange[:3, 2]
        mounted = robot.mount_positions[limb] + robot.mount_rotations[limb] @ tip
        places.append(position + base @ mounted)
    return np.array(places)


def manipulability(graph: PairGraph, q: Array) -> float:
    """`w_m` of a limb at joint angles, shape (6,) [rad], by its definition."""
    frames = forward_kinematics(q, graph.robot.limb.lengths)
    axes, origins = frames[:6, :3, 2], frames[:6, :3, 3]
    jacobian = np.vstack([np.cross(axes, frames[6, :3, 3] - origins).T, axes.T])
    return limb_manipulability(jacobian, graph.robot.characteristic_length)


def angles(graph: PairGraph, limb: int, point: int, base: tuple[Array, Array]) -> Array:
    """Joint angles of all branches with which a limb holds a point, shape (8, 6) [rad]."""
    out = Angles.rows(8)
    all_angles_at(
        graph.solver.shapes.rows, limb, pose(*base), graph.solver.grasps[point]["flange"], out
    )
    return np.array(out["q"])
