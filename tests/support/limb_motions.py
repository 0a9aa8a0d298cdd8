"""Motions to be checked, and where limbs are on them."""

import numpy as np
from compiled import called
from held_paths import path_between

from mlivr_gym import robot_spec
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.motion import DEPARTS, HOLDS, SWINGS, LimbMotion, SweepScratch
from mlivr_gym.collisions.sweep import sweep
from mlivr_gym.kinematics.base_path import base_poses
from mlivr_gym.kinematics.holding import joints_along
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import poses

ROBOT = robot_spec("mlivr2")


SHAPES = LimbShapes(ROBOT)


FIRST_ON_AXIS = int(SHAPES.limb["first_on_axis"])
"""First of the capsules that lie on the flange axis."""


REST = path_between((np.zeros(3), np.eye(3)) * 2)
"""The path of a base that stays at the origin."""


def in_body(limb, joints):
    """Ends of a limb's capsules in the body frame, shape (k, c, 2, 3)."""
    both = np.zeros((len(joints), 2, 6))
    both[:, limb] = joints
    here = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    return np.array([capsule_ends(ROBOT, SHAPES, (*here, q))[limb] for q in both])


def swinging(limb, start, end):
    """A limb that swings along a line in joint space, a row of `LimbMotion`."""
    out = LimbMotion.row()
    out["limb"], out["kind"], out["start"], out["end"] = limb, SWINGS, start, end
    return out


def eased(t):
    """Of a rounded corner, `collisions.sweep`: the weight of its end at a share of it."""
    return t**3 * (2.0 - t)


def at_corner(first, corner, last, t):
    """A rounded corner from its ends at shares of it, shape (k, n)."""
    rest, share = eased(1.0 - t)[:, None], eased(t)[:, None]
    return corner + rest * (first - corner) + share * (last - corner)


def round_corner(scratch, corner, *joints):
    """Let a motion, a row of `SweepScratch`, round a corner.

    Args:
        scratch: The motion, in a line so far.
        corner: Where the base is on its path at the corner.
        joints: Joint angles of the first and of the second limb there [rad].
    """
    moves = scratch["motion"]
    moves["rounded"], moves["corner"] = True, corner
    for limb, q in zip(("first", "second"), joints, strict=False):
        moves[limb]["corner"] = q


def holding(limb, branch, position, rotation):
    """A limb that holds with its flange at a place in the world, a row of `LimbMotion`."""
    out = LimbMotion.row()
    out["limb"], out["kind"], out["branch"] = limb, HOLDS, branch
    out["flange"]["position"], out["flange"]["rotation"] = position, rotation
    return out


def departing(limb, branch, position, rotation):
    """A limb that departs from where its flange is in the world, a row of `LimbMotion`."""
    out = holding(limb, branch, position, rotation)
    out["kind"] = DEPARTS
    return out


NOBODY = swinging(1, np.zeros(6), np.zeros(6))
"""A second limb that does not count."""


def motion(path, places, first, second=NOBODY, compared=()):
    """A motion to be checked, a row of `SweepScratch`.

    Args:
        path: Path of the base.
        places: Where the base is on it at the start and at the end.
        first: What the limb does that is checked.
        second: What another limb does meanwhile.
        compared: Names of what it is compared with: "boxes", "body", "resting" and "meeting".
    """
    scratch = SweepScratch.row()
    moves = scratch["motion"]
    moves["path"], moves["first"], moves["second"] = path, first, second
    moves["begin"], moves["finish"] = places
    for name in compared:
        moves[name] = True
    return scratch


def let_rest(scratch, limb, ends):
    """Put a limb at rest on each of some branches: ends of its capsules, shape (k, c, 2, 3)."""
    resting = scratch["resting"]
    resting["count"], resting["limb"][: len(ends)] = len(ends), limb
    for shapes, here in zip(resting["shapes"], ends, strict=False):
        shapes["ends"][: len(SHAPES)] = here


def answer(scratch, clearance, boxes=()):
    """What the compiled check says of a motion, among boxes and with a clearance [m]."""
    return called(sweep)(SHAPES.robot, box_grid(boxes), clearance, scratch)


def held_joints(graph, limb, point, branch, path, places):
    """Joint angles of a limb that holds at places of a base path, from 0 on, shape (k, 6)."""
    out = Angles.rows(len(places))
    bases = poses(*base_poses(path, places))
    flange = graph.solver.grasps["flange"][point : point + 1]
    reference = Angles.row()
    assert joints_along(SHAPES.rows, limb, bases, flange, branch, reference, out) == len(places)
    return out["q"]
