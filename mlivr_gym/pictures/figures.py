"""Figures drawn with matplotlib: what they share, and stick figures of configurations."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array
from mlivr_gym.files import write_whole
from mlivr_gym.kinematics.families import forward_kinematics
from mlivr_gym.robot.specification import LIMB_COLOURS, RobotSpec
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
"""Corners of each face of a box, in the order of `box_corners`."""


BASE_COLOUR, GOAL_COLOUR = "#2b8a3e", "#ffb703"
"""Colours of base paths, green as in the paper, and of goals."""

MOST_VERTICES, RASTER_DPI = 2000, 90
"""Paths with more vertices are an image in an SVG, of this many dots per inch.

They would fill the file: lines are thinned out when they are drawn, the edges of areas are not.
"""

SALT = "mlivr-gym"
"""What the names of parts in an SVG are made from, besides the parts."""

FACE_TINTS = {"deck": "#8a6d3b", "overhead": "#5a7d9a", "forward": "#7a7a7a", "aft": "#a3a3a3"}
"""Colours of points by the face they lie on; other faces are grey."""


def tints(grasp_map: GraspMap) -> list[str]:
    """Colour of each point of a map."""
    return [FACE_TINTS.get(face, "#8c8c8c") for face in grasp_map.faces]


def map_axes(grasp_map: GraspMap) -> tuple[Any, Any]:
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
        color=tints(grasp_map),
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


def draw_base_path(axes: Any, base: Array, goal: Sequence[float], label: str) -> None:
    """Draw a base path thick, and its goal as a star.

    Args:
        axes: Axes of `map_axes`.
        base: Base positions, shape (k, 3) [m].
        goal: Goal position [m].
        label: What the legend calls the path.
    """
    axes.plot(
        *base.T, color=BASE_COLOUR, linewidth=3.0, marker="s", markersize=5, zorder=5, label=label
    )
    axes.scatter(
        *np.array(goal),
        s=150,
        marker="*",
        color=GOAL_COLOUR,
        edgecolor="black",
        depthshade=False,
        zorder=7,
        label="goal",
    )


def add_heading(figure: Any, title: str, remark: str | None = None) -> None:
    """Write a heading, and below it a remark, at the upper left of a figure of `map_axes`."""
    figure.suptitle(title, x=0.02, y=0.975, ha="left", fontsize=13, parse_math=False)
    if remark is not None:
        figure.text(0.02, 0.91, remark, fontsize=9.5, color="0.25")


def add_legend(figure: Any) -> None:
    """Put the legend at the upper right of a figure of `map_axes`."""
    legend = figure.legend(
        loc="upper right", bbox_to_anchor=(0.985, 0.985), ncols=2, fontsize=8.5, frameon=False
    )
    for handle in legend.legend_handles:
        handle.set_alpha(1.0)


def box_corners(box: Box) -> Array:
    """The eight corners of a box, shape (8, 3) [m]."""
    signs = np.array(
        [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64
    )
    corners: Array = (signs * np.array(box.half)) @ np.array(box.rotation).T + np.array(box.centre)
    return corners


def figure_files(path: str | Path) -> tuple[Path, Path]:
    """The PNG file of a figure and the SVG file beside it; `path` names either."""
    given = Path(path)
    png, svg = (given.parent / f"{given.stem}{ending}" for ending in (".png", ".svg"))
    return (png, given) if given.suffix.lower() == ".svg" else (given, svg)


def save_figure(figure: Any, path: str | Path, *, vector: bool = True) -> None:
    """Write a figure as PNG and as SVG; see `write_figure`."""
    for axes in figure.axes:
        if axes.name == "3d":
            # The clip box of 3-D axes is a square in their middle, narrower than the module.
            for artist in axes.get_children():
                artist.set_clip_on(False)
    write_figure(figure, path, vector=vector)


def write_figure(figure: Any, path: str | Path, *, vector: bool = True) -> None:
    """Write a figure as it is as PNG and as SVG, each whole or not at all.

    The same figure gives the same bytes: nothing in the files is drawn by chance or dated.

    Args:
        figure: The figure.
        path: File to write; `figure_files` says which the two are.
        vector: Write the SVG too.

    Raises:
        FileError: If a file cannot be written.
    """
    from matplotlib import rc_context

    png, svg = figure_files(path)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    write_whole(png, buffer.getvalue())
    if vector:
        buffer = io.BytesIO()
        for axes in figure.axes:
            for paths in axes.collections:
                if sum(len(path.vertices) for path in paths.get_paths()) > MOST_VERTICES:
                    paths.set_rasterized(True)
        with rc_context({"svg.hashsalt": SALT}):
            figure.savefig(buffer, format="svg", metadata={"Date": None}, dpi=RASTER_DPI)
        write_whole(svg, buffer.getvalue())


def save_image(image: NDArray[np.uint8], path: str | Path) -> None:
    """Write a picture, shape (height, width, 3), as PNG, whole or not at all."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="png")
    write_whole(path, buffer.getvalue())


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
        configurations: Base position [m], base quaternion w, x, y, z, and joint angles, shape
            (N, 6) [rad], of each.
        path: PNG file to write.
        title: Heading.
    """
    from scipy.spatial.transform import Rotation

    figure, axes = map_axes(grasp_map)
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
    add_heading(figure, title)
    save_figure(figure, path, vector=False)  # in the place of a picture that is rendered
