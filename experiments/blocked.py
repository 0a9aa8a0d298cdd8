"""Draw a stance that meets all thresholds but collides with the cabin.

    python experiments/blocked.py [--out results]

Of all stances that only the collision check rules out, the one with the fewest contacts is shown,
with a close-up of its deepest contact. Writes `blocked.png`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from reports import command_line, two_limb_graph

from mlivr_gym import State
from mlivr_gym.collisions import Configuration, Contact
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.pictures import Camera, SceneRenderer, save_image, with_caption
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.scene import rgba
from mlivr_gym.stances import StanceGraph

SIZE = 900, 560
"""Width and height of each of the two pictures [px]."""

TOUCHING_COLOUR = "#e8590c"
"""Colour of shapes in contact, which neither limb has."""


def blocked_stance(
    checked: StanceGraph, free: StanceGraph
) -> tuple[Sequence[int], Configuration, list[Contact]]:
    """Return the stance with the fewest contacts among those that only collisions rule out."""
    best: tuple[Sequence[int], Configuration, list[Contact]] | None = None
    grasps, clearance = checked.solver.grasps, checked.settings.clearance
    for stance, branch_sets in zip(free.points, free.branch_sets, strict=True):
        if checked.find(stance.tolist()) >= 0 or checked.solver.point_cause[stance].any():
            continue
        if not checked.postures(stance[None]).cause[0]:
            continue
        here = free.configuration(State(tuple(stance.tolist()), tuple(branch_sets.tolist())))
        at = [(i, grasps["point"][p], grasps["normal"][p]) for i, p in enumerate(stance)]
        found = contacts(checked.robot, checked.grasp_map.boxes, here, clearance, at)
        if found and (best is None or len(found) < len(best[2])):
            best = stance.tolist(), here, found
    if best is None:
        raise SystemExit("no stance is blocked")
    return best


def main() -> None:
    """Draw both pictures and print the contacts."""
    out = command_line(__doc__).parse_args().out
    checked, free = two_limb_graph(), two_limb_graph(collisions=False)
    stance, here, found = blocked_stance(checked, free)
    renderer = SceneRenderer(free.grasp_map, free.robot, *SIZE, capsules=True)
    model, contact = renderer.model, found[0]
    for name in {name for each in found for name in (each.first, each.second)}:
        model.geom(name).rgba = rgba(TOUCHING_COLOUR)
    x, y, z = here[0].tolist()
    overview = renderer.render(*here, camera=Camera((x, y, z - 0.2), 3.0, 82.0, -12.0))
    pair, ends = (model.geom(name).id for name in (contact.first, contact.second)), np.empty(6)
    mujoco.mj_geomDistance(model, renderer.data, *pair, 1.0, ends)
    x, y, z = (0.5 * (ends[:3] + ends[3:])).tolist()
    close_up = renderer.render(*here, camera=Camera((x, y, z), 0.7, 110.0, -5.0))
    held = ", ".join(f"limb {i} holds {free.grasp_map.ids[p]}" for i, p in enumerate(stance))
    gap = f"{contact.first} is {1e3 * contact.distance:.0f} mm from {contact.second}"
    gap += f"; the clearance is {1e3 * checked.settings.clearance:.0f} mm"
    captions = f"A stance that is no node: {held}", gap
    both = [
        with_caption(picture, caption, SIZE[1])
        for picture, caption in zip((overview, close_up), captions, strict=True)
    ]
    out.mkdir(parents=True, exist_ok=True)
    save_image(np.concatenate(both), out / "blocked.png")
    for each in found:
        print(f"  {each.first} and {each.second}: {1000.0 * each.distance:.1f} mm")


if __name__ == "__main__":
    main()
