"""Draw a stance that meets all thresholds but collides with the cabin.

    python experiments/blocked.py [--out results]

Of all stances that only the collision check rules out, the one with the fewest contacts is shown,
with a close-up of its deepest contact. Writes `blocked.png` and `blocked.svg`.
"""

from __future__ import annotations

from reports import command_line, two_limb_graph

from mlivr_gym import State
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.pictures.blocked_figure import Panel, blocked_figure
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph


def blocked_stance(checked: TwoLimbGraph, free: TwoLimbGraph) -> Panel:
    """Return the stance with the fewest contacts among those that only collisions rule out."""
    best: Panel | None = None
    faces, ids = free.grasp_map.faces, free.grasp_map.ids
    grasps, clearance = checked.solver.grasps, checked.settings.clearance
    for stance, branch_sets in zip(free.points, free.branch_sets, strict=True):
        if checked.find(stance.tolist()) >= 0 or checked.solver.point_cause[stance].any():
            continue
        if not checked.postures(stance[None]).cause[0]:
            continue
        here = free.configuration(State(tuple(stance.tolist()), tuple(branch_sets.tolist())))
        at = [(i, grasps["point"][p], grasps["normal"][p]) for i, p in enumerate(stance)]
        found = contacts(checked.robot, checked.grasp_map.boxes, here, clearance, at)
        if found and (best is None or len(found) < len(best.contacts)):
            places = [f"{faces[p]} point {ids[p]}" for p in stance]
            held = ", ".join(f"limb {i} holds {place}" for i, place in enumerate(places))
            best = Panel(f"A stance that is no node:\n{held}", here, found)
    if best is None:
        raise SystemExit("no stance is blocked")
    return best


def main() -> None:
    """Draw the figure and print the contacts."""
    out = command_line(__doc__).parse_args().out
    checked, free = two_limb_graph(), two_limb_graph(collisions=False)
    panel = blocked_stance(checked, free)
    out.mkdir(parents=True, exist_ok=True)
    clearance = checked.settings.clearance
    blocked_figure(
        free.grasp_map, free.robot, [panel], (), out / "blocked.png", clearance=clearance
    )
    print(panel.title.replace("\n", " "))
    for contact in panel.contacts:
        print(f"  {contact.first} and {contact.second}: {1000.0 * contact.distance:.1f} mm")


if __name__ == "__main__":
    main()
