"""Films of a walk: animated GIF, or MP4 where `imageio` with its FFmpeg is installed."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.errors import RenderError
from mlivr_gym.files import write_whole
from mlivr_gym.pictures.rendering import SceneRenderer
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.recording import Recording
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

COLOURS = 128
"""Colours of a GIF's palette; more make the file larger and the picture hardly better."""


def film(
    grasp_map: GraspMap,
    robot: RobotSpec,
    recording: Recording,
    path: str | Path,
    *,
    size: tuple[int, int] = (640, 320),
    frames: int = 100,
    rate: float = 10.0,
    obstacles: Sequence[Box] = (),
    progress: Callable[[int], None] | None = None,
) -> None:
    """Render a recording from the side, the camera beside the robot, without the forward wall.

    Args:
        grasp_map: The map.
        robot: The robot.
        recording: What the robot did.
        path: File to write; `.gif`, or `.mp4` with the package `imageio[ffmpeg]`.
        size: Width and height [px].
        frames: Number of pictures, at equal times.
        rate: Pictures a second.
        obstacles: Boxes besides the map's.
        progress: Called with the number of pictures done.

    Raises:
        RenderError: If there is no GL library, or the kind of file cannot be written.
        FileError: If the file cannot be written.
    """
    kind = check_kind(path)
    renderer = SceneRenderer(grasp_map, robot, *size, obstacles)
    chosen = np.unique(np.linspace(0, len(recording.times) - 1, frames).round().astype(int))
    pictures = []
    for done, k in enumerate(chosen, 1):
        picture = renderer.render(
            recording.base_positions[k],
            recording.base_quaternions[k],
            recording.joint_positions[k],
            lookat=np.array([recording.base_positions[k, 0], 0.0, -0.1]),
            distance=3.3,
            azimuth=84.0,
            elevation=-8.0,
        )
        pictures.append(picture)
        if progress is not None:
            progress(done)
    renderer.close()
    write_whole(path, _gif(pictures, rate) if kind == ".gif" else _mp4(pictures, rate))


def check_kind(path: str | Path) -> str:
    """The ending of a film's name, if such a film can be written.

    Raises:
        RenderError: If it is neither `.gif` nor `.mp4`, or `imageio[ffmpeg]` is missing for an
            `.mp4`.
    """
    kind = Path(path).suffix.lower()
    if kind not in (".gif", ".mp4"):
        raise RenderError(f"cannot write a film as {str(path)!r}; valid endings are '.gif', '.mp4'")
    if kind == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise RenderError("an .mp4 needs the package imageio[ffmpeg]; without it, write a .gif")
    return kind


def _gif(pictures: list[NDArray[np.uint8]], rate: float) -> bytes:
    """An animated GIF of pictures, shape (height, width, 3), with one palette for all."""
    from PIL import Image

    images = [Image.fromarray(picture) for picture in pictures]
    palette = images[len(images) // 2].quantize(
        COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
    )
    small = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    buffer = io.BytesIO()
    small[0].save(
        buffer,
        format="gif",
        save_all=True,
        append_images=small[1:],
        duration=round(1000.0 / rate),
        loop=0,
        optimize=True,
    )
    return buffer.getvalue()


def _mp4(pictures: list[NDArray[np.uint8]], rate: float) -> bytes:
    """An MP4 of pictures, shape (height, width, 3)."""
    import imageio.v3 as iio

    encoded: bytes = iio.imwrite(
        "<bytes>", np.stack(pictures), extension=".mp4", fps=rate, plugin="FFMPEG"
    )
    return encoded
