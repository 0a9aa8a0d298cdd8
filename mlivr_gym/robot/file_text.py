"""The text of a URDF or MJCF file, and the bytes of meshes, as MuJoCo can take them."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from mlivr_gym.errors import RobotError, shortened
from mlivr_gym.files import LARGEST_FILE

MARKS = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))
"""First bytes of files, and the encoding that they tell."""

POINTER = "version https://git-lfs"
"""How a file begins that stands for one that Git LFS has not fetched."""

MOST_NESTED = 300
"""Largest depth of elements in elements."""

MESH_FORMATS = (".stl", ".obj", ".msh")
"""Endings of mesh files that MuJoCo reads."""

STL_HEAD, STL_FACE = 84, 50
"""Bytes of a binary STL before its triangles, and of each."""


def read_tree(path: Path) -> ElementTree.Element:
    """Return the elements of a file, of MJCF with those that it includes.

    Raises a `RobotError` if it cannot be read, or is no robot but what stands in its place.
    """
    tree = _parsed(_text(path))
    if tree.tag not in ("robot", "mujoco"):
        raise RobotError(
            f"the file's outermost element is <{tree.tag}>; it must be <robot> (URDF) or "
            "<mujoco> (MJCF)"
        )
    if tree.tag == "mujoco":
        _include(tree, path.parent, ())
    _check(tree, path.stem)
    return tree


def _text(path: Path) -> str:
    """Return the text of a file by its own declaration, and without that."""
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
    except (UnicodeError, LookupError):
        raise RobotError(f"the file cannot be read: not {encoding.upper()} text") from None
    return re.sub(r"^\s*<\?xml[^>]*\?>", "", text)


def _parsed(text: str) -> ElementTree.Element:
    start = text.lstrip()[:200].lower()
    if start.startswith(POINTER):
        raise RobotError("the file is a pointer of Git LFS; fetch it: git lfs pull")
    if start.startswith(("<!doctype html", "<html")):
        raise RobotError("the file is a web page; save the raw file in its place")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RobotError("the file defines entities, which are not read")
    # Extensions of simulators often use a prefix that the file does not declare.
    text = re.sub(r"(</?|\s)([A-Za-z_][\w.-]*):(?=[\w.-]+[\s=/>])", r"\1\2.", text)
    try:
        tree = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise RobotError(f"the file is not XML: {error}") from None
    if any(part.tag.startswith("xacro.") for part in tree.iter()):
        raise RobotError(
            "the file has elements of xacro; expand it first: xacro FILE > robot.urdf, or, without "
            "ROS, pip install xacrodoc and xacrodoc FILE -o robot.urdf"
        )
    return tree


def _include(tree: ElementTree.Element, folder: Path, before: tuple[str, ...]) -> None:
    """Put the contents of included files in their place; height fields, which no robot has, go."""
    for parent in list(tree.iter()):
        for k, part in reversed(list(enumerate(parent))):
            if part.tag == "include":
                name = part.get("file", "")
                if name in before:
                    raise RobotError(f"the file {name!r} includes itself")
                included = _parsed(_text(folder / name))
                _include(included, folder, (*before, name))
                parent[k : k + 1] = list(included)
            elif part.tag == "hfield" or part.get("hfield"):
                parent.remove(part)


def _check(element: ElementTree.Element, owner: str, depth: int = 1) -> None:
    """Refuse what is nested too deeply, and what is no number, of which MuJoCo only warns."""
    if depth > MOST_NESTED:
        raise RobotError("the file is nested too deeply")
    name = element.get("name", owner)
    for attribute, text in element.items():
        if attribute != "name" and "nan" in text.lower().replace("-", "").split():
            told = f"{element.tag} of {name!r} has {attribute} {text!r}"
            raise RobotError(f"{told}; numbers must be finite")
    for part in element:
        _check(part, name, depth + 1)


def mesh_file(name: str, folder: Path, folders: Sequence[Path]) -> Path | None:
    """Return the file of a mesh, None if it is not found or MuJoCo cannot read its format.

    Its name in a description that lies in `folder` may begin with `package://`, whose packages are
    looked for in `folders`, or with `file://`.
    """
    if name.startswith("package://"):
        places = [parent / name.removeprefix("package://") for parent in folders]
    else:
        places = [folder / name.removeprefix("file://")]
    if Path(name).suffix.lower() not in MESH_FORMATS:
        return None
    for place in places:
        try:
            if place.is_file():
                return place.resolve()
        except OSError:  # a name that no file can have
            continue
    return None


def mesh_bytes(path: Path) -> bytes:
    """Return the contents of a mesh file; an STL of text is made a binary one.

    Raises a `RobotError` if Git LFS has not fetched it.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RobotError(f"mesh {path.name!r} cannot be read: {error.strerror}") from None
    if data.startswith(POINTER.encode()):
        raise RobotError(
            f"mesh {shortened(path.name)} is a pointer of Git LFS; fetch it: git lfs pull, or take "
            "capsules='ur5e', simple ones along the links"
        )
    faces = int.from_bytes(data[STL_HEAD - 4 : STL_HEAD], "little")
    is_text = path.suffix.lower() == ".stl" and data.lstrip()[:5].lower() == b"solid"
    if not is_text or len(data) == STL_HEAD + STL_FACE * faces:
        return data
    found = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
    try:
        corners = np.array(found, dtype=np.float32).reshape(-1, 3, 3)
    except ValueError:
        raise RobotError(f"mesh {shortened(path.name)} is no STL file") from None
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("at", "<f4", (3, 3)), ("", "<u2")])
    rows["at"] = corners
    return bytes(STL_HEAD - 4) + struct.pack("<I", len(rows)) + rows.tobytes()
