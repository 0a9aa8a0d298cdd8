"""Films of executed plans: animated GIF, or MP4 if `imageio` with its FFmpeg is installed."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import FileName, InstanceOf, Reader, Validators, checked
from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.errors import RenderError, path_shown
from mlivr_gym.files import write_whole
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.joint_path import PHASES
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.captions import strip_height
from mlivr_gym.pictures.rendering import SIZE, SceneRenderer, Shot
from mlivr_gym.pictures.robot_shapes import robot_parts
from mlivr_gym.pictures.route import Route
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath, Flag, ListOf, OrNone, Tuples
from mlivr_gym.simulation.recording import Recording
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

DEFAULT_SIZE = (512, 288)
"""Default width and height of a film [px]."""

COLOURS = 96
"""Colours of a GIF's palette; more make the file larger and the picture hardly better."""

RATE = 10
"""Frames per second."""

MAX_FRAMES = 5000
"""Maximum number of frames of a film; they are held in memory until it is written."""

MAX_FILM_DURATION = 8.0
"""Maximum duration of a film at the default speed [s]."""

PAUSE = 1.0
"""Time for which the last frame stays [s]."""

SPEED = Tuples((), 0.1, 1000.0)
"""Valid speeds of a film relative to simulated time."""

AZIMUTH, ELEVATION = 84.0, -8.0
"""Angles of the camera's line of sight [deg]."""


# Validators of the arguments of all films.
FILM: Validators = {**ARGUMENTS, "size": SIZE, "speed": OrNone(SPEED)}


@checked(
    {
        **FILM,
        "recording": InstanceOf(Recording),
        "plan": OrNone(ARGUMENTS["plan"]),
        "capsules": Flag(),
    }
)
def film(
    grasp_map: GraspMap,
    robot: RobotSpec,
    recording: Recording,
    path: str | Path,
    *,
    plan: Plan | None = None,
    size: tuple[int, int] = DEFAULT_SIZE,
    speed: float | None = None,
    obstacles: Sequence[Box] = (),
    capsules: bool = False,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Film a recording from the side; the forward wall is hidden and the camera follows the robot.

    The camera is as close as possible while the robot stays inside every frame. With a plan the
    film shows base path, goal and footholds, and a caption with time, speed, step and phase. It
    has `RATE` frames a second; the last one stays for `PAUSE`. Raises a `RenderError` if no GL
    library can be used, or films of this format cannot be written, and a `FileError` if the file
    cannot be written.

    Parameters
    ----------
    grasp_map
        The map.
    robot
        The robot.
    recording
        Motion of the robot in simulation.
    path
        File to write: `.gif`, or `.mp4` with the package `imageio[ffmpeg]`.
    plan
        The plan that was executed; None to show the robot alone.
    size
        Width and height [px].
    speed
        Speed of the film relative to simulated time; by default `default_speed`.
    obstacles
        Boxes in addition to those of the map.
    capsules
        Draw limbs by their collision shapes, not by their visual meshes.
    progress
        Function called with the number of frames rendered so far.
    """
    check_film_format(path)
    speed = default_speed(recording) if speed is None else speed
    shots = recording_shots(grasp_map, recording, film_samples(recording, speed), plan, speed)
    pictures = film_pictures(
        grasp_map, robot, shots, size, obstacles, capsules=capsules, progress=progress
    )
    save_film(pictures, path)


def recording_shots(
    grasp_map: GraspMap, recording: Recording, samples: IntArray, plan: Plan | None, speed: float
) -> list[Shot]:
    """Return a shot for each of the given samples of a recording, with captions for a plan."""
    if plan is None:
        return [Shot(recording.configuration(int(k))) for k in samples]
    route = Route.of(grasp_map, plan)
    return [
        Shot(recording.configuration(k), (caption(recording, k, plan, speed),), route)
        for k in samples.tolist()
    ]


@checked({**FILM, "shots": ListOf(InstanceOf(Shot), 1)})
def film_pictures(
    grasp_map: GraspMap,
    robot: RobotSpec,
    shots: Sequence[Shot],
    size: tuple[int, int] = DEFAULT_SIZE,
    obstacles: Sequence[Box] = (),
    *,
    capsules: bool = False,
    progress: Callable[[int], None] | None = None,
) -> list[NDArray[np.uint8]]:
    """Take pictures of a size [px] by a camera that follows the robot; see `film`.

    All shots have as many captions.
    """
    width, height = size
    lower = height - len(shots[0].captions) * strip_height(height)
    renderer = SceneRenderer(grasp_map, robot, width, lower, obstacles, capsules)
    cameras = film_cameras(robot, [shot.configuration for shot in shots], width / lower)
    pictures = []
    for shot, camera in zip(shots, cameras, strict=True):
        pictures.append(shot.picture(renderer, height, camera))
        if progress is not None:
            progress(len(pictures))
    renderer.close()
    return pictures


def default_speed(recording: Recording) -> float:
    """Return the smallest power of two at which a film takes at most `MAX_FILM_DURATION`."""
    duration = float(recording.times[-1] - recording.times[0])
    return 2.0 ** max(0, math.ceil(math.log2(max(duration, 1e-9) / MAX_FILM_DURATION)))


def film_samples(recording: Recording, speed: float) -> IntArray:
    """Return the indices of the samples that a film shows, one for each frame.

    Raises a `RenderError` if there would be more than `MAX_FRAMES`.
    """
    begin, end = float(recording.times[0]), float(recording.times[-1])
    frames = math.ceil(RATE * (end - begin) / speed) + 1
    if frames > MAX_FRAMES:
        raise RenderError(
            f"at speed {speed:g} the film would have {frames} frames, more than {MAX_FRAMES}; "
            "choose a higher speed"
        )
    times = np.append(np.arange(begin, end, speed / RATE), end)
    samples: IntArray = np.searchsorted(recording.times, times - 1e-9)
    return samples


def _picture(value: Any, place: FieldPath) -> NDArray[np.uint8]:
    """Return a picture of three colours."""
    if not isinstance(value, np.ndarray) or value.dtype != np.uint8 or value.shape[2:] != (3,):
        raise place.refused(value, "a picture, bytes of shape (height, width, 3)")
    return value


@checked({"pictures": ListOf(Reader(_picture), 1)})
def save_film(pictures: list[NDArray[np.uint8]], path: str | Path) -> None:
    """Write pictures of shape (height, width, 3) as a film of `RATE` frames a second.

    The last one stays for `PAUSE`. Raises a `RenderError` if films of this format cannot be
    written, and a `FileError` if the file cannot be written.
    """
    kind = check_film_format(path)
    pictures = [*pictures, *[pictures[-1]] * round(PAUSE * RATE)]
    write_whole(path, _gif(pictures) if kind == ".gif" else mp4(pictures))


def film_cameras(
    robot: RobotSpec, configurations: Sequence[Configuration], aspect: float
) -> list[Camera]:
    """Return the camera of each picture; it follows the base along x at a constant distance.

    `aspect` is the width of a picture divided by its height.
    """
    seen = [
        np.concatenate([part.corners for part in robot_parts(robot, configuration)])
        for configuration in configurations
    ]
    everywhere = np.concatenate(seen)
    _, y, z = (0.5 * (everywhere.min(axis=0) + everywhere.max(axis=0))).tolist()
    cameras = [
        Camera((float(base[0]), y, z), azimuth=AZIMUTH, elevation=ELEVATION).seeing(
            corners, 0.0, aspect
        )
        for (base, *_), corners in zip(configurations, seen, strict=True)
    ]
    farthest = max(camera.distance for camera in cameras)
    return [camera._replace(distance=farthest) for camera in cameras]


def caption(recording: Recording, k: int, plan: Plan, speed: float = 1.0) -> str:
    """Return the caption of a sample: time, speed, step, phase, limb and its two points."""
    time, end = recording.times[k], recording.times[-1]
    number = min(int(recording.step[k]), len(plan.steps) - 1)
    step, phase = plan.steps[number], PHASES[int(recording.phase[k])]
    return (
        f"{time:.0f} s of {end:.0f} s (x{speed:g}), step {number + 1} of {len(plan.steps)}: "
        f"{phase}, limb {step.limb} from {step.from_point} to {step.to_point}"
    )


def check_film_format(path: str | Path) -> str:
    """Return the suffix of a film's file name, `".gif"` or `".mp4"`.

    Raises a `RenderError` if it is another one, or `imageio[ffmpeg]` is missing for an `.mp4`.
    """
    kind = Path(FileName().read(path, FieldPath("path", RenderError))).suffix.lower()
    if kind not in (".gif", ".mp4"):
        raise RenderError(
            f"cannot write a film as {path_shown(path)}; valid endings are '.gif' and '.mp4'"
        )
    if kind == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise RenderError(
            "an .mp4 needs the package imageio[ffmpeg]: pip install 'mlivr-gym[film]', "
            "or write a .gif"
        )
    return kind


def _gif(pictures: list[NDArray[np.uint8]]) -> bytes:
    """Encode pictures of shape (height, width, 3) as an animated GIF with one palette."""
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
        duration=1000 // RATE,
        loop=0,
        optimize=True,
    )
    return buffer.getvalue()


def mp4(pictures: list[NDArray[np.uint8]]) -> bytes:
    """Encode pictures of shape (height, width, 3) as MP4 with `RATE` frames a second."""
    import imageio.v3 as iio

    encoded: bytes = iio.imwrite(
        "<bytes>", np.stack(pictures), extension=".mp4", fps=RATE, plugin="FFMPEG"
    )
    return encoded
