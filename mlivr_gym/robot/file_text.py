"""The text of a robot file by its own declaration, and inertias that rounding made impossible."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from mlivr_gym.errors import RobotError

LARGEST_FILE = 20_000_000
"""Largest size of a file [bytes]."""

MOST_REPAIR = 0.01
"""Largest share by which a principal moment of inertia is made smaller."""

MARKS = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))
"""First bytes of files, and the encoding that they tell."""

NAMES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
"""Attributes of an inertia in URDF."""


def text_of(path: Path) -> str:
    """Return the text of a file, without its declaration.

    Raises a `RobotError` if it cannot be read, or is no robot but what stands in its place.
    """
    try:
        data = path.read_bytes() if path.stat().st_size <= LARGEST_FILE else b""
    except OSError as error:
        raise RobotError(f"the file cannot be read: {error.strerror}") from None
    if not data:
        raise RobotError(f"the file is empty or larger than {LARGEST_FILE} bytes")
    declared = re.match(rb"""<\?xml[^>]*encoding=["']([\w.-]+)""", data)
    encoding = declared[1].decode("ascii") if declared else "utf-8"
    encoding = next((name for mark, name in MARKS if data.startswith(mark)), encoding)
    try:
        text = data.decode(encoding)
    except (UnicodeDecodeError, LookupError):
        raise RobotError(f"the file cannot be read: not {encoding.upper()} text") from None
    text = re.sub(r"^\s*<\?xml[^>]*\?>", "", text)
    start = text.lstrip()[:200].lower()
    if start.startswith("version https://git-lfs"):
        raise RobotError("the file is a pointer of Git LFS; fetch it: git lfs pull")
    if start.startswith(("<!doctype html", "<html")):
        raise RobotError("the file is a web page; save the raw file in its place")
    return text


def repaired_inertias(tree: ElementTree.Element) -> list[str]:
    """Make the largest moment of each link of a URDF at most the sum of the others; return notes.

    No body has a larger one, but figures are often rounded so. It is changed by a share of
    `MOST_REPAIR` at most.
    """
    most, names = 0.0, []
    for link in tree.iter("link"):
        inertia = link.find("inertial/inertia")
        try:
            figures = [float(inertia.get(name, "0")) for name in NAMES] if inertia is not None else []
        except ValueError:
            continue  # MuJoCo says which
        if not figures or not np.isfinite(figures).all():
            continue
        xx, yy, zz, xy, xz, yz = figures
        moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        least = float(moments[0] + moments[1])
        share = float(moments[2]) / least - 1.0 if least > 0.0 else 0.0
        if not 0.0 < share <= MOST_REPAIR:
            continue
        moments[2] = least * (1.0 - 1e-12)
        whole = axes @ np.diag(moments) @ axes.T
        for name, (row, column) in zip(
            NAMES, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True
        ):
            inertia.set(name, repr(float(whole[row, column])))
        if share > 1e-9:
            most = max(most, share)
            names.append(link.get("name", ""))
    if not names:
        return []
    return [
        f"the largest moment of inertia of {', '.join(names)} made the sum of the others, by "
        f"{100.0 * most:.2g} % at most"
    ]
