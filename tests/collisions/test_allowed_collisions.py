"""Kernels, plain definition and MuJoCo omit exactly the pairs of the allowed collisions."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from coal_ruler import mujoco_pairs
from compiled import called
from wrist_arms import iiwa_from_file

from mlivr_gym import Box, robot_spec
from mlivr_gym.collisions.against_robot import (
    compare_limb_with_body,
    compare_limb_with_itself,
    compare_limbs,
)
from mlivr_gym.collisions.allowed_collisions import (
    ALLOWED_COLLISIONS,
    ANY,
    BOXES,
    OTHER,
    SAME,
)
from mlivr_gym.collisions.distances import CLEAR, SELF
from mlivr_gym.collisions.joint_lines import LimbPlace
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.placement import Shapes
from mlivr_gym.compiled.bit_sets import EVERY
from mlivr_gym.robot.capsules import LINKS
from mlivr_gym.simulation.scene import scene_spec

FAT = {
    "base": 2.5,
    "upper_arm": 2.0,
    "forearm": 2.0,
    "wrist_1": 2.0,
    "wrist_2": 2.0,
    "wrist_3": 2.0,
    "gripper": 2.0,
}


def fat(robot):
    """Return a robot whose capsules are so thick that only joints separate its links."""
    shapes = tuple(
        replace(c, radius=FAT.get(c.link, 1.0) * c.radius) for c in robot.mounted[0].capsules
    )
    return replace(robot, name="fat", capsules=shapes)


ROBOTS = [robot_spec("mlivr3"), fat(robot_spec("mlivr3")), iiwa_from_file(0.0)]


def left_out(robot):
    """Return the pairs of links that the table omits, and whether they belong to one limb."""
    checked = robot.name in ("mlivr2", "mlivr3")
    rows = [
        row for row in ALLOWED_COLLISIONS if row.whose != BOXES and (checked or not row.checked)
    ]
    found = set()
    for row in rows:
        pair = tuple(sorted((row.first, row.second)))
        found |= {(*pair, whose) for whose in (SAME, OTHER) if row.whose in (whose, ANY)}
    return {entry for entry in found if "body" not in entry or entry[2] == SAME}


def shaped(robot, pairs):
    """Return those of some pairs of which the robot has shapes."""
    there = {"body", *(shape.link for shape in robot.mounted[0].capsules)}
    return {pair for pair in pairs if {*pair[:2]} <= there}


def every_pair():
    """Return all pairs of links, of one limb and of two, and of the body with each link."""
    links = list(itertools.combinations_with_replacement(sorted(LINKS), 2))
    return {(*pair, whose) for pair in links for whose in (SAME, OTHER)} | {
        (*sorted(("body", link)), SAME) for link in LINKS
    }


def compared_by_name(names):
    """Return pairs of links from pairs of names like `limb0/forearm/0` and `body`."""
    found = set()
    for first, second in names:
        a, b = first.split("/"), second.split("/")
        same = "body" in (first, second) or a[0] == b[0]
        found.add(
            (
                *sorted((a[-2] if len(a) > 1 else a[0], b[-2] if len(b) > 1 else b[0])),
                SAME if same else OTHER,
            )
        )
    return found


def compared_by_kernels(robot):
    """Return the pairs that a kernel reports when they, and no other shapes, overlap."""
    shapes = LimbShapes(robot)
    count, still = len(shapes), LimbPlace.row()
    lonely = np.empty((count, 2, 3))
    lonely[:] = 10.0 * np.arange(1, count + 1)[:, None, None]

    def at(ends):
        out = Shapes.row()
        out["ends"][:count] = ends
        return out

    def against_own(ends, row=shapes.robot):
        """A limb against itself, the body and the mounts."""
        limb, here = row["limbs"][0], at(ends)
        still["in_body"] = here
        itself, _ = called(compare_limb_with_itself)(limb, still, EVERY, 0.0)
        return max(itself, called(compare_limb_with_body)(row, limb, here, EVERY, 0.0)[0])

    assert against_own(lonely) == CLEAR
    found = set()
    for a, b in itertools.combinations(range(count), 2):
        ends = lonely.copy()
        ends[b] = ends[a]
        if against_own(ends) == SELF:
            found.add((*sorted((shapes.names[a], shapes.names[b])), SAME))
    mounts, half = shapes.mounts["ends"], shapes.robot["half"]
    for c, name in enumerate(shapes.names):
        places = {("body", SAME): [0.0, 0.0, half[2]]} | {
            ("base", SAME if m == 0 else OTHER): 2.0 * mounts[m, 1] for m in range(robot.limbs)
        }  # fmt: skip
        for (other, whose), place in places.items():
            ends = lonely.copy()
            ends[c] = np.array(place)
            thin = shapes.rows.copy()[0]
            thin["limbs"][0]["capsules"]["radius"] = 0.01 if other == "body" else 0.14
            if other == "body":
                thin["mounts"]["radius"] = 1e-3
            if against_own(ends, thin) == SELF:
                found.add((*sorted((other, name)), whose))
        for d, other in enumerate(shapes.names):
            away = lonely + 1000.0
            away[d] = lonely[c]
            limbs = shapes.limb, at(lonely), shapes.robot["limbs"][1], at(away)
            if called(compare_limbs)(*limbs, EVERY, 0.0)[0] == SELF:
                found.add((*sorted((name, other)), OTHER))
    return found


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_the_kernels_leave_out_what_the_table_says(robot):
    found = every_pair() - compared_by_kernels(robot)
    assert shaped(robot, found) == shaped(robot, left_out(robot))


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_mujoco_leaves_out_what_the_table_says(ladder, robot):
    box = Box.between("crate", "obstacle", (1.0, 1.0, 1.0), (2.0, 2.0, 2.0))
    pairs = mujoco_pairs(scene_spec(ladder, robot, (box,)).compile())
    shapes = {pair for pair in pairs if all(name.startswith(("body", "limb")) for name in pair)}
    assert shaped(robot, every_pair() - compared_by_name(shapes)) == shaped(robot, left_out(robot))
    links = {shape.link for shape in robot.mounted[0].capsules}
    names = {f"limb{i}/{link}/0" for i in range(robot.limbs) for link in links} | {"body"}
    with_box = {pair for pair in pairs if "box/crate" in pair}
    assert {name for pair in with_box for name in pair if name != "box/crate"} == names
