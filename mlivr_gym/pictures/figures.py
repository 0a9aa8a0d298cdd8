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
from mlivr_gym.files import FileError, write_whole, written_together
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

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


def box_corners(box: Box) -> Array:
    """Return the eight corners of a box, shape (8, 3) [m]."""
    signs = np.array(list(product((-1.0, 1.0), repeat=3)))
    corners: Array = (signs * np.array(box.half)) @ np.array(box.rotation).T + np.array(box.centre)
    return corners


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
    """Write a figure as PNG and SVG, both completely or neither.

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
    with written_together():
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
