"""Elements that the figures drawn with matplotlib share, and how figures are written."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array
from mlivr_gym.errors import path_shown
from mlivr_gym.files import FileError, write_whole
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
"""Corners of each face of a box, as indices into `box_corners`."""

BASE_COLOUR, GOAL_COLOUR = "#2b8a3e", "#ffb703"
"""Colours of base paths, green as in the paper, and of goals."""

MAX_VERTICES, RASTER_DPI = 2000, 90
"""Areas with more vertices are rasterised in an SVG, at this many dots per inch.

Otherwise they would dominate its size: matplotlib simplifies lines, but not the edges of areas.
"""

SALT = "mlivr-gym"
"""Salt of the ids in an SVG, which makes them the same each time."""

FACE_COLOURS = {"deck": "#8a6d3b", "overhead": "#5a7d9a", "forward": "#7a7a7a", "aft": "#a3a3a3"}
"""Colours of points by the face they lie on; other faces are grey."""


def point_colours(grasp_map: GraspMap) -> list[str]:
    """Return the colour of each point of a map."""
    return [FACE_COLOURS.get(face, "#8c8c8c") for face in grasp_map.faces]


def new_figure(width: float, height: float) -> Any:
    """Create a figure of a size [inch] that opens no window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110)
    FigureCanvasAgg(figure)
    return figure


def map_axes(grasp_map: GraspMap) -> tuple[Any, Any]:
    """Create a 3-D figure of a map, to scale: tracks are thin lines, points are dots."""
    figure = new_figure(12.8, 6.4)
    axes: Any = figure.add_axes((-0.06, -0.14, 1.08, 1.22), projection="3d", computed_zorder=False)
    for segment in grasp_map.segments:
        axes.plot(*np.array([segment.start, segment.end]).T, color="0.82", linewidth=1.2, zorder=1)
    style = {"s": 4, "color": point_colours(grasp_map), "depthshade": False, "zorder": 2}
    axes.scatter(*grasp_map.positions.T, label="graspable points", **style)
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


def draw_base_path(axes: Any, line: Array, stances: Array, label: str) -> None:
    """Draw a base path, shape (k, 3), and the bases of stances, shape (s, 3) [m], as squares."""
    axes.plot(*line.T, color=BASE_COLOUR, linewidth=3.0, zorder=5, label=label)
    axes.scatter(*stances.T, color=BASE_COLOUR, marker="s", s=30, depthshade=False, zorder=5)


def draw_goal(axes: Any, goal: Sequence[float], tolerance: float) -> None:
    """Draw a goal position [m] as a star, and the goal region as a ball."""
    style = {"color": GOAL_COLOUR, "edgecolor": "black", "depthshade": False, "zorder": 7}
    axes.scatter(*np.array(goal), s=150, marker="*", label="goal", **style)
    angle, rise = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, np.pi, 9))
    ball = np.stack([np.cos(angle) * np.sin(rise), np.sin(angle) * np.sin(rise), np.cos(rise)])
    ball = np.array(goal)[:, None, None] + tolerance * ball
    axes.plot_wireframe(*ball, color=GOAL_COLOUR, linewidth=0.4, alpha=0.7, zorder=4)


def add_heading(figure: Any, title: str, remark: str | None = None) -> None:
    """Write a heading and a remark below it, at the upper left of a figure."""
    figure.suptitle(title, x=0.02, y=0.975, ha="left", fontsize=13, parse_math=False)
    if remark is not None:
        figure.text(0.02, 0.91, remark, fontsize=9.5, color="0.25")


def add_legend(figure: Any) -> None:
    """Add a legend at the upper right of a figure."""
    legend = figure.legend(
        loc="upper right", bbox_to_anchor=(0.985, 0.985), ncols=2, fontsize=8.5, frameon=False
    )
    for handle in legend.legend_handles:
        handle.set_alpha(1.0)


def box_corners(box: Box) -> Array:
    """Return the eight corners of a box, shape (8, 3) [m]."""
    signs = np.array(list(product((-1.0, 1.0), repeat=3)))
    corners: Array = (signs * np.array(box.half)) @ np.array(box.rotation).T + np.array(box.centre)
    return corners


def box_faces(box: Box) -> Array:
    """Return the corners of the six faces of a box, shape (6, 4, 3) [m]."""
    corners = box_corners(box)
    return np.array([corners[list(face)] for face in FACES])


def figure_files(path: str | Path) -> tuple[Path, Path]:
    """Return the PNG and the SVG file of a figure; `path` names either.

    Raises a `FileError` if it ends otherwise.
    """
    check_ending(path, (".png", ".svg"))
    named = Path(path)
    png, svg = (named.parent / f"{named.stem}{ending}" for ending in (".png", ".svg"))
    return (png, named) if named.suffix.lower() == ".svg" else (named, svg)


def check_ending(path: str | Path, endings: Sequence[str]) -> None:
    """Raise a `FileError` if the name of a picture has an ending that is none of some."""
    if Path(path).suffix.lower() not in ("", *endings):
        valid = " and ".join(map(repr, endings))
        raise FileError(f"cannot write a picture as {path_shown(path)}; valid endings are {valid}")


def save_figure(figure: Any, path: str | Path, *, vector: bool = True) -> None:
    """Write a figure as PNG and SVG; each file is written completely or not at all.

    The same figure always gives the same bytes: the files contain no random ids and no dates. The
    path names either file, see `figure_files`; without `vector` no SVG is written. 3-D axes are not
    clipped. Raises a `FileError` if a file cannot be written.
    """
    from matplotlib import rc_context

    for axes in figure.axes:
        if axes.name == "3d":
            # The clip box of 3-D axes is a central square that is narrower than the module.
            for artist in axes.get_children():
                artist.set_clip_on(False)
    png, svg = figure_files(path)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    write_whole(png, buffer.getvalue())
    if vector:
        buffer = io.BytesIO()
        for axes in figure.axes:
            for paths in axes.collections:
                if sum(len(path.vertices) for path in paths.get_paths()) > MAX_VERTICES:
                    paths.set_rasterized(True)
        with rc_context({"svg.hashsalt": SALT}):
            figure.savefig(buffer, format="svg", metadata={"Date": None}, dpi=RASTER_DPI)
        write_whole(svg, buffer.getvalue())


def save_image(image: NDArray[np.uint8], path: str | Path) -> None:
    """Write a picture of shape (height, width, 3) as PNG, completely or not at all.

    Raises a `FileError` if it cannot be written, or has another ending than `.png`.
    """
    check_ending(path, (".png",))
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="png")
    write_whole(path, buffer.getvalue())
