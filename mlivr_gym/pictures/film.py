"""Films of a walk: animated GIF, or MP4 where `imageio` with its FFmpeg is installed."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import FileName, Of, Via, checked
from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.contacts import Configuration, capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.errors import RenderError, path_shown
from mlivr_gym.files import write_whole
from mlivr_gym.motion.arguments import WALK
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.regrasp import PHASES
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.captions import strip_height, with_caption
from mlivr_gym.pictures.rendering import SIZE, SceneRenderer
from mlivr_gym.pictures.route import Route
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath, Maybe, Tuples
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

if TYPE_CHECKING:
    from mlivr_gym.simulation.recording import Recording

USUAL_SIZE = (512, 288)
"""Width and height of a film whose size is not chosen [px]."""

COLOURS = 96
"""Colours of a GIF's palette; more make the file larger and the picture hardly better."""

RATE = 25
"""Pictures a second."""

LONGEST = 8.0
"""Length of a film whose speed is not chosen, at most [s]."""

PAUSE = 1.0
"""For how long the last picture stays [s]."""

SPEED = Tuples((), 0.1, 1000.0)
"""How many times faster than the clock a film may run."""

AZIMUTH, ELEVATION = 84.0, -8.0
"""Direction in which the camera looks [deg]."""


def _recording(value: Any, place: FieldPath) -> Recording:
    """A recording of a simulation."""
    from mlivr_gym.simulation.recording import Recording

    recording: Recording = Of(Recording).read(value, place)
    return recording


@checked(
    {
        **WALK,
        "recording": Via(_recording),
        "plan": Maybe(WALK["plan"]),
        "size": SIZE,
        "speed": Maybe(SPEED),
    }
)
def film(
    grasp_map: GraspMap,
    robot: RobotSpec,
    recording: Recording,
    path: str | Path,
    *,
    plan: Plan | None = None,
    size: tuple[int, int] = USUAL_SIZE,
    speed: float | None = None,
    obstacles: Sequence[Box] = (),
    progress: Callable[[int], None] | None = None,
) -> None:
    """Film a recording from the side, the camera beside the robot, without the forward wall.

    The camera is as near as it can be while the robot stays inside every picture. Of the plan it
    shows base path, goal and footholds, and below each picture time, speed of the film, step and
    phase. There are `RATE` pictures a second; the last one stays for `PAUSE`.

    Parameters
    ----------
    grasp_map
        The map.
    robot
        The robot.
    recording
        What the robot did.
    path
        File to write; `.gif`, or `.mp4` with the package `imageio[ffmpeg]`.
    plan
        The plan that was carried out; without one, none of it is shown.
    size
        Width and height [px].
    speed
        How many times faster than the clock it runs; by default `usual_speed`.
    obstacles
        Boxes besides the map's.
    progress
        Called with the number of pictures done.

    Raises
    ------
    RenderError
        If there is no GL library, or the kind of file cannot be written.
    FileError
        If the file cannot be written.
    """
    check_kind(path)
    speed = usual_speed(recording) if speed is None else speed
    pictures = film_pictures(
        grasp_map, robot, recording, film_samples(recording, speed), plan=plan, size=size,
        speed=speed, obstacles=obstacles, progress=progress,
    )  # fmt: skip
    save_film(pictures, path)


def usual_speed(recording: Recording) -> float:
    """The least power of two as a speed with which a film of a recording lasts `LONGEST`."""
    duration = float(recording.times[-1] - recording.times[0])
    return 2.0 ** max(0, math.ceil(math.log2(max(duration, 1e-9) / LONGEST)))


def film_samples(recording: Recording, speed: float) -> IntArray:
    """The samples of a recording that a film shows, one for each `1 / RATE` of its time."""
    begin, end = float(recording.times[0]), float(recording.times[-1])
    times = np.append(np.arange(begin, end, speed / RATE), end)
    samples: IntArray = np.searchsorted(recording.times, times - 1e-9)
    return samples


def save_film(pictures: list[NDArray[np.uint8]], path: str | Path) -> None:
    """Write pictures, shape (height, width, 3), as a film of `RATE` pictures a second.

    The last one stays for `PAUSE`.

    Raises
    ------
    RenderError
        If the kind of file cannot be written.
    FileError
        If the file cannot be written.
    """
    kind = check_kind(path)
    pictures = [*pictures, *[pictures[-1]] * round(PAUSE * RATE)]
    write_whole(path, _gif(pictures) if kind == ".gif" else _mp4(pictures))


def film_pictures(
    grasp_map: GraspMap,
    robot: RobotSpec,
    recording: Recording,
    samples: IntArray,
    *,
    plan: Plan | None = None,
    size: tuple[int, int] = USUAL_SIZE,
    speed: float = 1.0,
    obstacles: Sequence[Box] = (),
    progress: Callable[[int], None] | None = None,
) -> list[NDArray[np.uint8]]:
    """The pictures of a film, one for each of some samples of a recording; see `film`."""
    width, height = size
    picture_height = height - (strip_height(height) if plan is not None else 0)
    renderer = SceneRenderer(grasp_map, robot, width, picture_height, obstacles)
    shown = [_configuration(recording, int(k)) for k in samples]
    cameras = film_cameras(robot, shown, width / picture_height)
    route = Route.of(grasp_map, plan) if plan is not None else None
    pictures = []
    for done, (k, configuration, camera) in enumerate(zip(samples, shown, cameras, strict=True), 1):
        picture = renderer.render(*configuration, camera=camera, route=route)
        if plan is not None:
            words = caption(recording, int(k), plan, speed)
            picture = with_caption(picture, words, height)
        pictures.append(picture)
        if progress is not None:
            progress(done)
    renderer.close()
    return pictures


def film_cameras(
    robot: RobotSpec, configurations: Sequence[Configuration], aspect: float
) -> list[Camera]:
    """A camera for each picture, which goes along x with the base and keeps its distance.

    Parameters
    ----------
    robot
        The robot.
    configurations
        Where it is in each picture.
    aspect
        Width of a picture over its height.
    """
    shapes = LimbShapes(robot)
    around = max(float(limb.radii.max()) for limb in shapes.each)
    around = max(around, robot.body_radius)
    bases = [configuration[0] for configuration in configurations]
    ends = []
    for base, configuration in zip(bases, configurations, strict=True):
        places = np.vstack([base, capsule_ends(robot, shapes, configuration).reshape(-1, 3)])
        ends.append(places[~np.isnan(places[:, 0])])
    everywhere = np.concatenate(ends)
    _, y, z = (0.5 * (everywhere.min(axis=0) + everywhere.max(axis=0))).tolist()
    cameras = [
        Camera((float(base[0]), y, z), azimuth=AZIMUTH, elevation=ELEVATION).seeing(
            places, around, aspect
        )
        for base, places in zip(bases, ends, strict=True)
    ]
    farthest = max(camera.distance for camera in cameras)
    return [camera._replace(distance=farthest) for camera in cameras]


def caption(recording: Recording, k: int, plan: Plan, speed: float = 1.0) -> str:
    """Time and speed, step and phase of a sample of a recording, and where the limb goes."""
    time, end = recording.times[k], recording.times[-1]
    number = min(int(recording.step[k]), len(plan.steps) - 1)
    step, phase = plan.steps[number], PHASES[int(recording.phase[k])]
    return (
        f"{time:.0f} s of {end:.0f} s (x{speed:g}), step {number + 1} of {len(plan.steps)}: "
        f"{phase}, limb {step.limb} from {step.from_point} to {step.to_point}"
    )


def _configuration(recording: Recording, k: int) -> Configuration:
    """Where the robot is in a sample of a recording."""
    return (
        recording.base_positions[k],
        recording.base_quaternions[k],
        recording.joint_positions[k],
    )


def check_kind(path: str | Path) -> str:
    """The ending of a film's name, if such a film can be written.

    Raises
    ------
    RenderError
        If it is neither `.gif` nor `.mp4`, or `imageio[ffmpeg]` is missing for an
        `.mp4`.
    """
    kind = Path(FileName().read(path, FieldPath("path", RenderError))).suffix.lower()
    if kind not in (".gif", ".mp4"):
        told = f"cannot write a film as {path_shown(path)}"
        raise RenderError(f"{told}; valid endings are '.gif', '.mp4'")
    if kind == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise RenderError("an .mp4 needs the package imageio[ffmpeg]; without it, write a .gif")
    return kind


def _gif(pictures: list[NDArray[np.uint8]]) -> bytes:
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
        duration=1000 // RATE,
        loop=0,
        optimize=True,
    )
    return buffer.getvalue()


def _mp4(pictures: list[NDArray[np.uint8]]) -> bytes:
    """An MP4 of pictures, shape (height, width, 3)."""
    import imageio.v3 as iio

    encoded: bytes = iio.imwrite(
        "<bytes>", np.stack(pictures), extension=".mp4", fps=RATE, plugin="FFMPEG"
    )
    return encoded
