"""What collision checks rule out, for one stance and one step, as a picture.

    python experiments/blocked.py [--out results]

writes `blocked.png`, and an SVG beside it: a stance that meets the thresholds, but not without
touching the cabin, and a step between two free stances on which the robot would touch something, at
the worst place; below each a close-up of the worst contact.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from blocked_steps import grasps_at, held_along

from mlivr_gym import Settings, State, jem_map, stance_graph
from mlivr_gym.arrays import IntArray
from mlivr_gym.collisions.contacts import Configuration, contacts
from mlivr_gym.kinematics.base_path import STRAIGHT, base_path
from mlivr_gym.kinematics.poses import pose, quaternion
from mlivr_gym.pictures.blocked_figure import Panel, blocked_figure
from mlivr_gym.stances.pair_graph import PairGraph


def blocked_stance(checked: PairGraph, free: PairGraph) -> Panel:
    """The stance with the fewest contacts of those that only collisions rule out."""
    best: Panel | None = None
    for s in range(len(free)):
        stance = free.points[s]
        if checked.find(stance.tolist()) >= 0 or checked.solver.point_cause[stance].any():
            continue
        if not checked.postures(stance[None]).cause[0]:
            continue
        here = free.configuration(State(tuple(stance.tolist()), tuple(free.mask[s].tolist())))
        grasps = grasps_at(free, enumerate(stance))
        found = contacts(free.robot, free.grasp_map.boxes, here, checked.settings.clearance, grasps)
        if found and (best is None or len(found) < len(best.contacts)):
            held = ", ".join(f"limb {i} holds {_place(free, p)}" for i, p in enumerate(stance))
            best = Panel(f"A stance that is no node:\n{held}", here, found)
    if best is None:
        raise SystemExit("no stance is blocked")
    return best


def blocked_step(checked: PairGraph, free: PairGraph) -> Panel:
    """The first step between two stances on which the robot would reach into something."""
    for s in range(0, len(checked), 7):
        for held in range(2):
            row = checked.row(held, s)[::5]
            possible = free.edge_masks(
                held, free.find(checked.points[s]), _indices(free, checked, row)
            )
            entries = checked.edge_masks(held, s, row)
            for s1 in row[(possible > 0) & (entries == 0) & (checked.mask[row] > 0).all(axis=1)]:
                panel = _along(checked, held, s, int(s1))
                if panel is not None and panel.contacts[0].distance < 0.0:
                    return panel
    raise SystemExit("no step is blocked")


def _indices(free: PairGraph, checked: PairGraph, stances: IntArray) -> IntArray:
    """Indices in the graph without collisions of stances of the other."""
    return np.array([free.find(checked.points[s]) for s in stances], dtype=np.int64)


def _along(graph: PairGraph, held: int, s0: int, s1: int) -> Panel | None:
    """The worst configuration of a step, one limb holding on its first branch, the other folded."""
    point, mover = int(graph.points[s0, held]), 1 - held
    mask = int(graph.mask[s0, held] & graph.mask[s1, held])
    if not mask:
        return None
    branch = (mask & -mask).bit_length() - 1 & 7
    ends = (pose(graph.base_in_world[s], graph.base_axes_in_world[s]) for s in (s0, s1))
    path = base_path(*ends, STRAIGHT, np.zeros(3))
    held_at = held_along(graph, held, point, branch, path)
    if held_at is None:
        return None
    along: list[Configuration] = []
    for position, rotation, angles in zip(*held_at, strict=True):
        joints = np.empty((2, 6))
        joints[held], joints[mover] = angles, (*graph.robot.folds[0], 0.0)
        along.append((position, quaternion(rotation), joints))
    grasps = grasps_at(graph, [(held, point)])
    found = [
        contacts(graph.robot, graph.grasp_map.boxes, c, graph.settings.clearance, grasps)
        for c in along
    ]
    worst = min(range(len(along)), key=lambda n: found[n][0].distance if found[n] else np.inf)
    if not found[worst]:
        return None
    ends = [_place(graph, int(graph.points[s, mover])) for s in (s0, s1)]
    title = (
        f"A step that is no edge: limb {mover}, folded, from {ends[0]}\n"
        f"to {ends[1]}, while limb {held} holds {_place(graph, point)}"
    )
    return Panel(title, along[worst], found[worst])


def _place(graph: PairGraph, point: int) -> str:
    """A point in words, its face first."""
    return f"{graph.grasp_map.faces[point]} point {graph.grasp_map.ids[point]}"


def main() -> None:
    """Draw both."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("results"), help="folder for the picture")
    args = parser.parse_args()
    checked, free = (
        stance_graph(jem_map()),
        stance_graph(jem_map(), settings=Settings(collisions=False)),
    )
    assert isinstance(checked, PairGraph)
    assert isinstance(free, PairGraph)
    panels = [blocked_stance(checked, free), blocked_step(checked, free)]
    args.out.mkdir(parents=True, exist_ok=True)
    blocked_figure(
        free.grasp_map,
        free.robot,
        panels,
        (),
        args.out / "blocked.png",
        clearance=checked.settings.clearance,
    )
    for panel in panels:
        print(panel.title.replace("\n", " "))
        for contact in panel.contacts:
            print(f"  {contact.first} and {contact.second}: {1000.0 * contact.distance:.1f} mm")


if __name__ == "__main__":
    main()
