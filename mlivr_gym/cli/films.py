"""Films that commands make: their options, and what is told of them."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from mlivr_gym.cli.arguments import option
from mlivr_gym.cli.progress import Progress
from mlivr_gym.errors import RenderError
from mlivr_gym.pictures.films import (
    DEFAULT_SIZE,
    MAX_FILM_DURATION,
    RATE,
    SPEED,
    default_speed,
    film_samples,
)
from mlivr_gym.pictures.rendering import SIZE
from mlivr_gym.simulation.recording import Recording


def film_options(parser: argparse.ArgumentParser) -> None:
    """Add size and speed of a film to the options of a command."""
    option(parser, "--size W H", "width and height of the film [px]", DEFAULT_SIZE, SIZE)
    option(
        parser,
        "--speed X",
        f"speed of the film relative to simulated time, at {RATE} frames a second "
        f"(default: such that the film takes at most {MAX_FILM_DURATION:g} s)",
        valid=SPEED,
    )


def make_film(
    args: argparse.Namespace, path: str | Path, recording: Recording, make: Callable[..., None]
) -> bool:
    """Make a film, or print why it cannot be made; return whether it was.

    `make` is called with its `size`, `speed` and `progress`.
    """
    try:
        speed = default_speed(recording) if args.speed is None else args.speed
        frames = len(film_samples(recording, speed))
        with Progress("frames rendered", frames, args.quiet) as progress:
            make(size=args.size, speed=speed, progress=progress.show)
    except RenderError as error:
        print(f"no film: {error}")
        return False
    print(f"film: {path}")
    return True
