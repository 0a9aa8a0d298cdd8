"""Figures drawn with matplotlib: the map with plans on it, and a plain picture of a configuration."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.files import write_whole
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.world.boxes import BOX, scene_name
from mlivr_gym.world.grasp_map import GraspMap

if TYPE_CHECKING:
    from mlivr_gym.collisions.contacts import Contact
    from mlivr_gym.motion.plan import Plan
    from mlivr_gym.robot.specification import RobotSpec
    from mlivr_gym.world.boxes import Box

Array = NDArray[np.float64]

MOST_EXPLORED = 4000
"""Explored base paths drawn at most; of more, an even selection is drawn."""


def _axes(grasp_map: GraspMap) -> tuple[Any, Any]:
    """A 3-D figure of the map: tracks as thin lines, points as dots, equal scale."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.8, 6.4), dpi=110)
    FigureCanvasAgg(figure)
    axes: Any = figure.add_axes((-0.06, -0.14, 1.08, 1.22), projection="3d", computed_zorder=False)
    for segment in grasp_map.segments:
        axes.plot(*np.array([segment.start, segment.end]).T, color="0.82", linewidth=1.2, zorder=1)
    axes.scatter(
        *grasp_map.positions.T,
        s=4,
        color="0.55",
        depthshade=False,
        zorder=2,
        label="graspable points",
    )
    low, high = grasp_map.positions.min(axis=0), grasp_map.positions.max(axis=0)
    span = np.maximum(high - low, 0.3)
    axes.set_box_aspect(span.copy(), zoom=1.3)  # the array is changed in place
    for name, a, b in zip("xyz", low, low + span, strict=True):
        getattr(axes, f"set_{name}lim")(a - 0.05, b + 0.05)
    axes.set_xlabel("x [m] (Node 2 to airlock)", labelpad=18)
    axes.set_ylabel("y [m]", labelpad=2)
    axes.set_zlabel("z [m]", labelpad=-2)
    axes.set_yticks([-1, 0, 1])
    axes.set_zticks([-1, 0, 1])
    axes.tick_params(labelsize=8)
    axes.view_init(elev=18, azim=-72)
    return figure, axes


def save_figure(figure: Any, path: str | Path) -> None:
    """Write a figure as PNG, whole or not at all."""
    for axes in figure.axes:
        if axes.name == "3d":
            # The clip box of 3-D axes is a square in their middle, narrower than the module.
            for artist in axes.get_children():
                artist.set_clip_on(False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    write_whole(path, buffer.getvalue())


def plan_figure(
    grasp_map: GraspMap, plan: Plan, path: str | Path, tree: Array | None = None, title: str = ""
) -> None:
    """Picture of a plan: explored base paths thin, chosen base path thick, footholds of each limb in its colour.

    Args:
        grasp_map: The map.
        plan: The plan.
        path: PNG file to write.
        tree: Base positions at both ends of each explored step, shape (e, 2, 3) [m].
        title: Heading.
    """
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    figure, axes = _axes(grasp_map)
    explored = np.zeros((0, 2, 3)) if tree is None else tree
    drawn = explored[:: max(1, -(-len(explored) // MOST_EXPLORED))]
    if len(drawn):
        axes.add_collection3d(
            Line3DCollection(
                drawn,
                colors="#2a9d8f",
                linewidths=0.4,
                alpha=0.35,
                zorder=3,
                label="explored base paths",
            )
        )
    index = {point: i for i, point in enumerate(grasp_map.ids)}
    base = plan.motion.base_positions
    for limb in range(plan.world.robot.limbs):
        held = grasp_map.positions[[index[stance[limb]] for stance in plan.stances]]
        colour = LIMB_COLOURS[limb]
        for position, point in zip(base, held, strict=True):
            axes.plot(
                *np.array([position, point]).T, color=colour, linewidth=0.7, alpha=0.6, zorder=4
            )
        axes.plot(*held.T, color=colour, linewidth=0.9, linestyle=":", zorder=4)
        axes.scatter(
            *held.T,
            s=46,
            color=colour,
            edgecolor="white",
            depthshade=False,
            zorder=6,
            label=f"footholds of limb {limb}",
        )
    axes.plot(
        *base.T,
        color="#c1121f",
        linewidth=3.0,
        marker="s",
        markersize=5,
        zorder=5,
        label="base path",
    )
    axes.scatter(
        *np.array(plan.query.goal),
        s=150,
        marker="*",
        color="#ffb703",
        edgecolor="black",
        depthshade=False,
        zorder=7,
        label="goal",
    )
    figure.suptitle(title or "Plan", x=0.02, y=0.975, ha="left", fontsize=13, parse_math=False)
    count = f" ({len(drawn)} of {len(explored)} drawn)" if len(drawn) < len(explored) else ""
    figure.text(
        0.02, 0.91,
        f"{len(plan.steps)} steps, base translation {plan.base_translation:.2f} m, least $w_m$ {plan.w_m_min:.3f}, "
        f"least $w_b$ {plan.w_b_min:.4f}, {plan.statistics.expanded} states explored{count}",
        fontsize=9.5, color="0.25",
    )  # fmt: skip
    figure.legend(
        loc="upper right", bbox_to_anchor=(0.985, 0.985), ncols=2, fontsize=8.5, frameon=False
    )
    save_figure(figure, path)


def walk_figure(
    grasp_map: GraspMap, walked: Array, planned: list[Array], obstacles: Sequence[Box],
    occupied: Sequence[str],
    goal: Sequence[float], path: str | Path,
) -> None:  # fmt: skip
    """Picture of a walk among obstacles: base path walked thick, what had been planned dashed.

    Args:
        grasp_map: The map.
        walked: Base positions, shape (k, 3) [m].
        planned: Base positions of each plan made on the way.
        obstacles: Boxes in the way.
        occupied: Ids of points that were not to be grasped.
        goal: Goal position [m].
        path: PNG file to write.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    figure, axes = _axes(grasp_map)
    for box in obstacles:
        corners = _corners(box)
        faces = [[corners[v] for v in face] for face in _FACES]
        axes.add_collection3d(
            Poly3DCollection(faces, facecolor="#d95926", edgecolor="#d95926", alpha=0.3, zorder=3)
        )
        axes.text(
            *corners.max(axis=0), box.id, fontsize=9, color="#a03000", zorder=8, parse_math=False
        )
    if occupied:
        taken = grasp_map.positions[[grasp_map.index(point) for point in occupied]]
        axes.scatter(
            *taken.T,
            s=50,
            marker="x",
            color="#d00000",
            depthshade=False,
            zorder=6,
            label="points occupied",
        )
    for k, base in enumerate(planned):
        axes.plot(
            *base.T,
            linestyle="--",
            linewidth=1.4,
            color=LIMB_COLOURS[k + 2],
            zorder=4,
            label=f"plan {k + 1}",
        )
    axes.plot(
        *walked.T,
        color="#c1121f",
        linewidth=3.0,
        marker="s",
        markersize=5,
        zorder=5,
        label="base path walked",
    )
    axes.scatter(
        *np.array(goal),
        s=150,
        marker="*",
        color="#ffb703",
        edgecolor="black",
        depthshade=False,
        zorder=7,
        label="goal",
    )
    figure.suptitle(
        "A walk interrupted twice", x=0.02, y=0.975, ha="left", fontsize=13, parse_math=False
    )
    length = float(np.linalg.norm(np.diff(walked, axis=0), axis=1).sum())
    told = f"{len(walked) - 1} steps, base translation {length:.2f} m, {len(planned)} plans"
    figure.text(0.02, 0.91, told, fontsize=9.5, color="0.25")
    figure.legend(
        loc="upper right", bbox_to_anchor=(0.985, 0.985), ncols=2, fontsize=8.5, frameon=False
    )
    save_figure(figure, path)


def configuration_figure(
    grasp_map: GraspMap,
    robot: RobotSpec,
    configurations: list[tuple[Array, Array, Array]],
    path: str | Path,
    title: str,
) -> None:
    """Stick figures of configurations on the map, for machines without GL.

    Args:
        grasp_map: The map.
        robot: The robot.
        configurations: Base position [m], base quaternion w, x, y, z, and joint angles (N, 6) [rad]
            of each.
        path: PNG file to write.
        title: Heading.
    """
    from scipy.spatial.transform import Rotation

    from mlivr_gym.kinematics.ur import forward_kinematics

    figure, axes = _axes(grasp_map)
    for position, quaternion, joints in configurations:
        base = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        axes.scatter(*position, s=120, marker="s", color="0.2", depthshade=False, zorder=6)
        for i, q in enumerate(joints):
            mount = base @ robot.mount_rotations[i]
            origin = position + base @ robot.mount_positions[i]
            frames = forward_kinematics(q, robot.limb.lengths)
            flange = frames[6, :3, 3] + robot.tool_length * frames[6, :3, 2]
            chain = np.vstack([frames[:, :3, 3], flange]) @ mount.T + origin
            axes.plot(
                *np.vstack([position, chain]).T,
                color=LIMB_COLOURS[i],
                linewidth=3,
                marker="o",
                markersize=3,
                zorder=5,
            )
    figure.suptitle(title, x=0.02, y=0.975, ha="left", fontsize=13, parse_math=False)
    save_figure(figure, path)


def blocked_figure(
    grasp_map: GraspMap,
    robot: RobotSpec,
    panels: list[tuple[str, list[tuple[Array, Array, Array]], list[Contact]]],
    obstacles: Sequence[Box],
    path: str | Path,
) -> None:
    """What configurations touch: the robot's capsules, those that touch something and what they touch in red.

    Args:
        grasp_map: The map.
        robot: The robot.
        panels: For each picture its heading, configurations along a motion (the last one is drawn
            in full, the others thin), and what the last one touches.
        obstacles: Boxes besides the map's own.
        path: PNG file to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    from mlivr_gym.collisions.contacts import capsule_ends
    from mlivr_gym.collisions.limb_shapes import LimbShapes

    figure = Figure(figsize=(6.4 * len(panels), 6.8), dpi=110)
    FigureCanvasAgg(figure)
    shapes = LimbShapes(robot)
    boxes = {box.id: box for box in (*grasp_map.boxes, *obstacles)}
    for k, (title, configurations, touching) in enumerate(panels):
        axes: Any = figure.add_subplot(
            1, len(panels), k + 1, projection="3d", computed_zorder=False
        )
        named = {name for contact in touching for name in (contact.first, contact.second)}
        for n, configuration in enumerate(configurations):
            last = n == len(configurations) - 1
            ends = capsule_ends(robot, shapes, configuration)
            for i in range(robot.limbs):
                for c, name in enumerate(shapes.names):
                    hit = last and f"limb{i}/{name}/{shapes.names[:c].count(name)}" in named
                    axes.plot(
                        *ends[i, c].T, color="#d00000" if hit else LIMB_COLOURS[i],
                        solid_capstyle="round",
                        linewidth=150.0 * shapes.arrays[2][c] if last else 1.0,
                        alpha=0.9 if last else 0.35,
                        zorder=6 if hit else 5 if last else 4,
                    )  # fmt: skip
            if last:
                axes.scatter(
                    *configuration[0], s=260, marker="s", color="0.25", depthshade=False, zorder=5
                )
        centre = configurations[-1][0]
        for box in boxes.values():
            hit = scene_name(BOX, box.id) in named
            if not hit and (
                box.kind not in ("track", "handrail", "obstacle") or not _near(box, centre)
            ):
                continue
            corners = np.clip(_corners(box), centre - 1.1, centre + 1.1)
            faces = [[corners[v] for v in face] for face in _FACES]
            colour = "#d00000" if hit else "#1a59bf" if box.kind == "handrail" else "0.55"
            axes.add_collection3d(
                Poly3DCollection(
                    faces, facecolor=colour, edgecolor=colour, linewidths=0.6, alpha=0.12, zorder=3
                )
            )
        low, high = centre - 1.1, centre + 1.1
        for name, a, b in zip("xyz", low, high, strict=True):
            getattr(axes, f"set_{name}lim")(a, b)
            getattr(axes, f"set_{name}label")(f"{name} [m]")
        axes.set_box_aspect((1, 1, 1), zoom=1.12)
        axes.tick_params(labelsize=7)
        axes.view_init(elev=14, azim=-66)
        axes.set_title(title, fontsize=11, loc="left")
        lines = [f"{c.first} to {c.second}: {1000.0 * c.distance:.0f} mm" for c in touching[:4]]
        if len(touching) > 4:
            lines.append(f"and {len(touching) - 4} more pairs")
        axes.text2D(
            0.0,
            0.985,
            "\n".join(lines),
            transform=axes.transAxes,
            fontsize=8.5,
            color="#a00000",
            va="top",
        )
    figure.subplots_adjust(left=0.03, right=0.97, bottom=0.12, top=0.92, wspace=0.02)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    write_whole(path, buffer.getvalue())


_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def _corners(box: Box) -> Array:
    """The eight corners of a box [m], shape (8, 3)."""
    signs = np.array(
        [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64
    )
    corners: Array = (signs * np.array(box.half)) @ np.array(box.rotation).T + np.array(box.centre)
    return corners


def _near(box: Box, centre: Array) -> bool:
    """Whether the whole box lies in the picture round a centre."""
    return bool((np.abs(_corners(box) - centre) < 1.3).all())


def save_image(image: NDArray[np.uint8], path: str | Path) -> None:
    """Write a picture, shape (height, width, 3), as PNG, whole or not at all."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="png")
    write_whole(path, buffer.getvalue())
