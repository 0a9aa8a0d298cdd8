"""Figure of the contacts of configurations: an overview and a close-up of each."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, Contact
from mlivr_gym.pictures.contact_names import (
    WitnessPoints,
    contact_sentence,
    shape_name,
    witness_points,
)
from mlivr_gym.pictures.figures import box_corners, box_faces, new_figure, write_figure
from mlivr_gym.pictures.robot_shapes import (
    GHOST_PALENESS,
    JOINT_COLOUR,
    TOUCHING_COLOUR,
    Part,
    capsule_faces,
    draw_robot,
    outline,
    pale,
    robot_parts,
)
from mlivr_gym.robot.specification import LIMB_COLOURS, RobotSpec
from mlivr_gym.world.boxes import BOX, Box, scene_name
from mlivr_gym.world.grasp_map import GraspMap

HALF_SIDE = 0.9
"""Half the side of the cube that a panel shows [m]."""

HALF_CLOSE_UP = 0.16
"""Half the height of a close-up [m]."""

MAX_CONTACTS = 4
"""Maximum number of contacts that are listed in a panel."""

MARK_COLOUR = "#c2255c"
"""Colour of the mark at a contact."""

BOX_COLOURS = {"track": "#8f959c", "handrail": "#1a59bf", "stanchion": "#5c636a"}
"""Colours of boxes by kind; other boxes are light grey."""


_GAP_STYLE: dict[str, Any] = {
    "fontsize": 10, "color": MARK_COLOUR, "textcoords": "offset points", "zorder": 9,
}  # fmt: skip


class Panel(NamedTuple):
    """A configuration with contacts, as one panel of the figure."""

    title: str
    """Heading of the panel."""
    configuration: Configuration
    """Configuration of the robot."""
    contacts: Sequence[Contact]
    """Contacts of the robot in it, the worst first."""


def blocked_figure(
    grasp_map: GraspMap,
    robot: RobotSpec,
    panels: Sequence[Panel],
    obstacles: Sequence[Box],
    path: str | Path,
    *,
    clearance: float,
) -> None:
    """Draw the contacts of configurations as PNG and SVG.

    Each panel shows the robot among the boxes, and below it a close-up of the worst contact with
    the clearance that shapes must keep [m].
    """
    figure = new_figure(6.6 * len(panels), 10.2)
    boxes = {scene_name(BOX, box.id): box for box in (*grasp_map.boxes, *obstacles)}
    for k, panel in enumerate(panels):
        parts = {part.name: part for part in robot_parts(robot, panel.configuration)}
        first = panel.contacts[0]
        witness = witness_points(parts[first.first], (parts | boxes)[first.second])
        offset, width = (k + 0.02) / len(panels), 0.96 / len(panels)
        axes: Any = figure.add_axes(
            (offset, 0.36, width, 0.55), projection="3d", computed_zorder=False
        )
        _overview(axes, panel, parts, boxes, witness)
        lines = _contact_lines(panel.contacts, parts, boxes)
        figure.text(offset + 0.01, 0.975, panel.title, fontsize=10.5, va="top", linespacing=1.4)
        figure.text(offset + 0.01, 0.925, lines, fontsize=9, color=MARK_COLOUR, va="top")
        flat = figure.add_axes((offset + 0.03, 0.045, width - 0.06, 0.29))
        _close_up(flat, parts, boxes, first, witness, clearance)
    _add_legend(figure, robot)
    write_figure(figure, path)


def _add_legend(figure: Any, robot: RobotSpec) -> None:
    """Add a legend of the colours of limbs, joints and shapes in contact."""
    from matplotlib.patches import Patch

    names = {f"limb {i}": LIMB_COLOURS[i] for i in range(robot.limbs)}
    names |= {"shapes that touch": TOUCHING_COLOUR, "joints, not checked": JOINT_COLOUR}
    figure.legend(
        handles=[Patch(color=colour, label=name) for name, colour in names.items()],
        loc="lower center",
        ncols=len(names),
        fontsize=9,
        frameon=False,
    )


def _contact_lines(
    contacts: Sequence[Contact], parts: Mapping[str, Part], boxes: Mapping[str, Box]
) -> str:
    """Describe the worst contact of each shape of the robot, one line each."""
    shapes: dict[str, Part | Box] = {**parts, **boxes}
    worst = {c.first: c for c in reversed(contacts)}
    listed = [c for c in contacts if worst[c.first] is c][:MAX_CONTACTS]
    lines = [
        contact_sentence(c, witness_points(parts[c.first], shapes[c.second]).gap, boxes)
        for c in listed
    ]
    if len(contacts) > len(listed):
        count = len(contacts) - len(listed)
        lines.append(f"and {count} more {'contact' if count == 1 else 'contacts'}")
    return "\n".join(lines)


def _overview(
    axes: Any,
    panel: Panel,
    parts: Mapping[str, Part],
    boxes: Mapping[str, Box],
    witness: WitnessPoints,
) -> None:
    """Draw the robot, the boxes round it, and a ring about the worst contact."""
    from mpl_toolkits.mplot3d import proj3d

    centre = panel.configuration[0]
    touching = {name for contact in panel.contacts for name in (contact.first, contact.second)}
    _draw_boxes(axes, boxes, centre, touching)
    draw_robot(axes, list(parts.values()), touching)
    for name, a, b in zip("xyz", centre - HALF_SIDE, centre + HALF_SIDE, strict=True):
        getattr(axes, f"set_{name}lim")(a, b)
        getattr(axes, f"set_{name}label")(f"{name} [m]")
    axes.set_box_aspect((1, 1, 1), zoom=1.05)
    axes.tick_params(labelsize=7)
    # The view is from the side where the touched shape stands behind the robot.
    away = -witness.normal
    axes.view_init(elev=-14 if away[2] < -0.7 else 16, azim=-66 if away[1] <= 0.3 else 66)
    x, y, _ = proj3d.proj_transform(*witness.first, axes.get_proj())
    arrow = {"arrowstyle": "-|>", "color": MARK_COLOUR, "linewidth": 1.6}
    axes.annotate(_gap(witness), (x, y), (60, 46), arrowprops=arrow, **_GAP_STYLE)
    ring = {"facecolor": "none", "edgecolor": MARK_COLOUR, "linewidth": 2.0}
    axes.scatter(*witness.first, s=420, depthshade=False, zorder=8, **ring)


def _draw_boxes(
    axes: Any, boxes: Mapping[str, Box], centre: Array, touching: Collection[str]
) -> None:
    """Draw the boxes round a centre; those in `touching` are orange."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    for name, box in boxes.items():
        hit, small = name in touching, box.kind in (*BOX_COLOURS, "obstacle")
        low, high = box.bounds
        inside = bool(((low < centre + HALF_SIDE) & (high > centre - HALF_SIDE)).all())
        if not (hit or (small and inside)) or (hit and box.kind == "panel"):
            continue
        faces = np.clip(box_faces(box), centre - HALF_SIDE, centre + HALF_SIDE)
        colour = TOUCHING_COLOUR if hit else BOX_COLOURS.get(box.kind, "#b0b5ba")
        style = {"facecolor": colour, "edgecolor": colour, "linewidths": 0.6}
        alpha, zorder = (0.25 if hit and not small else 0.7), (3 if hit else 2)
        axes.add_collection3d(Poly3DCollection(faces, **style, alpha=alpha, zorder=zorder))


def _close_up(
    axes: Any,
    parts: Mapping[str, Part],
    boxes: Mapping[str, Box],
    contact: Contact,
    witness: WitnessPoints,
    clearance: float,
) -> None:
    """Draw a contact to scale, in a view in which the gap lies in the picture plane."""
    across = _view(parts[contact.first], witness.normal)
    middle = 0.5 * (witness.first + witness.second)
    shapes: dict[str, Part | Box] = {**parts, **boxes}
    toward = np.cross(across[0], across[1])
    inside = [
        name
        for name, shape in shapes.items()
        if _is_in_depth(shape, middle, toward)
        and (isinstance(shape, Part) or shape.kind in BOX_COLOURS or name == contact.second)
    ]
    for name in sorted(inside, key=lambda n: float(_middle(shapes[n]) @ toward)):
        shape, hit = shapes[name], name in (contact.first, contact.second)
        if isinstance(shape, Part):
            faces = capsule_faces(shape.axes[0], shape.radius, 96) if shape.radius else shape.faces
            colour = TOUCHING_COLOUR if hit else pale(shape.colour, 0.5 * GHOST_PALENESS)
        else:
            faces, colour = box_faces(shape), "#b0b5ba" if hit else "#e3e5e8"
        axes.fill(
            *(outline(faces, across) - middle @ across.T).T,
            facecolor=colour,
            edgecolor="0.25" if hit else "0.6",
            linewidth=1.4 if hit else 0.6,
            alpha=0.85 if hit else 0.6,
            zorder=4 if hit else 2,
        )
    capsule = parts[contact.first]
    if capsule.radius > 0.0:
        wide = capsule_faces(capsule.axes[0], capsule.radius + clearance, 96)
        axes.fill(
            *(outline(wide, across) - middle @ across.T).T,
            fill=False,
            edgecolor=MARK_COLOUR,
            linestyle="--",
            linewidth=1.2,
            zorder=5,
        )
    _mark(axes, witness, across, middle)
    first, second = shape_name(contact.first, boxes), shape_name(contact.second, boxes)
    axes.set_title(
        f"close-up: {first} and {second}; dashed: the clearance of {1e3 * clearance:.0f} mm",
        fontsize=9.5,
        loc="left",
        color="0.25",
    )
    limits = {"xlim": (-1.9 * HALF_CLOSE_UP, 1.9 * HALF_CLOSE_UP), "xticks": [], "yticks": []}
    axes.set(aspect="equal", ylim=(-HALF_CLOSE_UP, HALF_CLOSE_UP), **limits)
    start, height = -1.8 * HALF_CLOSE_UP, -0.9 * HALF_CLOSE_UP
    axes.plot([start, start + 0.1], [height, height], color="black", linewidth=3, zorder=7)
    axes.text(start, height + 0.008, "100 mm", fontsize=8.5, zorder=7)


def _mark(axes: Any, witness: WitnessPoints, across: Array, middle: Array) -> None:
    """Mark the two witness points and write the gap next to them."""
    ends = (np.stack([witness.first, witness.second]) - middle) @ across.T
    axes.plot(*ends.T, color=MARK_COLOUR, linewidth=2.0, marker="o", markersize=4, zorder=8)
    behind = {"boxstyle": "round", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
    arrow = {"arrowstyle": "-", "color": MARK_COLOUR}
    middle_of_gap = ends.mean(axis=0)
    axes.annotate(
        _gap(witness), middle_of_gap, (56, 40), bbox=behind, arrowprops=arrow, **_GAP_STYLE
    )


def _gap(witness: WitnessPoints) -> str:
    """Format the distance of two shapes, or how deep they overlap."""
    gap = 1e3 * witness.gap
    return f"{gap:.0f} mm apart" if gap > 0.0 else f"{-gap:.0f} mm deep"


def _view(part: Part, normal: Array) -> Array:
    """Return the axes of a picture plane that contains the gap and the capsule's axis, (2, 3)."""
    start, end = part.axes[0]
    depth = np.cross(end - start, normal)
    if np.linalg.norm(depth) < 1e-6:
        depth = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    depth /= np.linalg.norm(depth)
    up = np.array([0.0, 0.0, 1.0]) - depth[2] * depth
    if np.linalg.norm(up) < 0.2:
        up = np.array([0.0, 1.0, 0.0]) - depth[1] * depth
    up /= np.linalg.norm(up)
    return np.stack([np.cross(up, depth), up])


def _middle(shape: Part | Box) -> Array:
    """Return the centre of a shape, shape (3,) [m]."""
    return shape.faces.mean(axis=(0, 1)) if isinstance(shape, Part) else np.array(shape.centre)


def _is_in_depth(shape: Part | Box, middle: Array, toward: Array) -> bool:
    """Return whether a part of a shape lies within the depth range of a close-up."""
    corners = shape.faces.reshape(-1, 3) if isinstance(shape, Part) else box_corners(shape)
    depth = (corners - middle) @ toward
    return bool(depth.min() < HALF_CLOSE_UP and depth.max() > -HALF_CLOSE_UP)
