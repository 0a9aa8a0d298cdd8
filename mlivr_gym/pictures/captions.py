"""Captions and labels on rendered pictures."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array

MIN_CAPTION_HEIGHT = 120
"""Minimum height of a picture with text, which could not be read on smaller ones [px]."""

Image = NDArray[np.uint8]


def strip_height(height: int) -> int:
    """Return the height of the caption in a picture of total height `height` [px]."""
    return 0 if height < MIN_CAPTION_HEIGHT else max(22, height // 18)


def with_caption(picture: Image, caption: str, height: int) -> Image:
    """Add a line of text below a picture; `height` is the total height with the text [px].

    Of a text that is too long, even in the smallest letters, the last words are left out.
    """
    strip = strip_height(height)
    if not strip:
        return picture
    from PIL import Image as Pillow
    from PIL import ImageDraw

    line = Pillow.new("RGB", (picture.shape[1], strip), "white")
    draw = ImageDraw.Draw(line)
    size, available = max(9, round(0.62 * strip)), picture.shape[1] - strip
    while size > 9 and draw.textlength(caption, font=_font(size)) > available:
        size -= 1
    shown, words = caption, caption.split()
    while len(words) > 1 and draw.textlength(shown, font=_font(size)) > available:
        words.pop()
        shown = " ".join([*words, "..."])
    draw.text((0.5 * strip, 0.5 * strip), shown, fill="black", font=_font(size), anchor="lm")
    return np.concatenate([picture, np.asarray(line)])


def with_labels(picture: Image, pixels: Array, labels: list[tuple[str, str]]) -> Image:
    """Draw labels, each a text and its colour, with white outlines on a picture.

    `pixels` are column and row of each label, shape (k, 2) [px]. Labels outside are omitted, and
    those that would cover one before them.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw

    if picture.shape[0] < MIN_CAPTION_HEIGHT - strip_height(MIN_CAPTION_HEIGHT):
        return picture
    image = Pillow.fromarray(picture)
    draw = ImageDraw.Draw(image)
    font, edge = _font(max(10, picture.shape[0] // 30)), max(1, picture.shape[0] // 300)
    drawn: list[Array] = []
    for (column, row), (text, colour) in zip(pixels.tolist(), labels, strict=True):
        if not (0.0 <= column < image.width and 0.0 <= row < image.height):
            continue
        style: dict[str, Any] = {"font": font, "anchor": "mm", "stroke_width": edge}
        box = np.array(draw.textbbox((column, row), text, **style))
        if any((box[:2] < one[2:]).all() and (one[:2] < box[2:]).all() for one in drawn):
            continue
        drawn.append(box)
        draw.text((column, row), text, fill=colour, stroke_fill="white", **style)
    return np.asarray(image)


@cache
def _font(size: int) -> Any:
    """Return matplotlib's default font in a size [px]."""
    import matplotlib
    from PIL import ImageFont

    file = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(file), size)
