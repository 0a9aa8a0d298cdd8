"""Limbs over k moments: where their capsules are, limbs that hold, how far they are from what."""

from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from coal_ruler import Ruler, apart, capsule
from compiled import called
from held_paths import path_between
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from mlivr_gym import State, robot_spec
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.distances import CLEAR, segments_distance
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.motion import DEPARTS, HOLDS, SWINGS, LimbMotion, Sweep
from mlivr_gym.collisions.sweep import sweep
from mlivr_gym.kinematics.base_path import base_poses
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.path_following import joints_along, poses
from mlivr_gym.stances.checked_steps import join

ROBOT = robot_spec("mlivr2")


SHAPES = LimbShapes(ROBOT)


RADII = SHAPES.radii


HAND = int(SHAPES.limb["hand"])
"""First of the capsules that lie on the flange axis."""


REST = path_between((np.zeros(3), np.eye(3)) * 2)
"""The path of a base that stays at the origin."""


def draw(rng):
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)


def in_body(limb, joints):
    """Ends of a limb's capsules in the body frame, shape (k, c, 2, 3)."""
    both = np.zeros((len(joints), 2, 6))
    both[:, limb] = joints
    here = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    return np.array([capsule_ends(ROBOT, SHAPES, (*here, q))[limb] for q in both])


def least_apart(first, second):
    """Least distance of two limbs' capsules, ends (k, c, 2, 3): value, moment and pair."""
    # Distances of middles tell which pairs are worth a look.
    reach = (
        np.linalg.norm(np.ptp(first, axis=2), axis=-1)[:, :, None]
        + np.linalg.norm(np.ptp(second, axis=2), axis=-1)[:, None]
    )
    between = first.mean(axis=2)[:, :, None] - second.mean(axis=2)[:, None]
    rough = np.linalg.norm(between, axis=-1) - 0.5 * reach
    rough -= RADII[:, None] + RADII[None]
    best = (np.inf, None)
    for index in np.argsort(rough, axis=None):
        k, i, j = np.unravel_index(int(index), rough.shape)
        if rough[k, i, j] > best[0]:
            break
        p, q = first[k, i], second[k, j]
        axes = (p[0], p[1] - p[0], q[0], q[1] - q[0])
        gap = segments_distance(*(tuple(v) for v in axes))
        best = min(best, (gap - RADII[i] - RADII[j], (int(k), int(i), int(j))))
    return best


def by_coal(first, second, at):
    k, i, j = at
    return apart(capsule(RADII[i], *first[k, i]), capsule(RADII[j], *second[k, j]))


def shift_to(first, second, direction, gap):
    """A shift of the second limb after which its least distance from the first is `gap` [m].

    From where both forearms cross in the middle it goes in a direction until they are that far
    apart.
    """
    half = len(first) // 2
    crossed = first[half, 2].mean(axis=0) - second[half, 2].mean(axis=0)
    x = 0.0
    while least_apart(first, second + crossed + x * direction)[0] < gap:
        x += 0.05
    root = brentq(
        lambda x: least_apart(first, second + crossed + x * direction)[0] - gap,
        x - 0.05,
        x,
        xtol=1e-6,
    )
    shift = crossed + root * direction
    at = least_apart(first, second + shift)[1]
    assert by_coal(first, second + shift, at) == pytest.approx(gap, abs=1e-4)
    return shift


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


def round_corner(room, corner, *joints):
    """Let a motion, a row of `Sweep`, round a corner.

    Args:
        room: The motion, in a line so far.
        corner: Where the base is on its path at the corner.
        joints: Joint angles of the first and of the second limb there [rad].
    """
    moves = room["motion"]
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
    """A motion to be checked, a row of `Sweep`.

    Args:
        path: Path of the base.
        places: Where the base is on it at the start and at the end.
        first: What the limb does that is checked.
        second: What another limb does meanwhile.
        compared: Names of what it is compared with: "boxes", "body", "resting" and "meeting".
    """
    room = Sweep.row()
    moves = room["motion"]
    moves["path"], moves["first"], moves["second"] = path, first, second
    moves["begin"], moves["finish"] = places
    for name in compared:
        moves[name] = True
    return room


def let_rest(room, limb, ends):
    """Put a limb at rest on each of some branches: ends of its capsules, shape (k, c, 2, 3)."""
    resting = room["resting"]
    resting["count"], resting["limb"][: len(ends)] = len(ends), limb
    for shapes, here in zip(resting["shapes"], ends, strict=False):
        shapes["ends"][: len(SHAPES)] = here


def answer(room, clearance, boxes=(), robot=SHAPES.robot):
    """What the compiled check says of a motion, among boxes and with a clearance [m]."""
    return called(sweep)(robot, box_grid(boxes), clearance, room)


class Hold(NamedTuple):
    """A limb that holds a point on a branch while the base follows a path, at k moments."""

    graph: object
    limb: int
    point: int
    branch: int
    path: object
    joints: np.ndarray  # (k, 6)

    @classmethod
    def random(cls, graph, rng, samples=151):
        """What a random edge of a graph holds on."""
        while True:
            s0, limb = int(rng.integers(len(graph))), int(rng.integers(2))
            s1 = int(rng.choice(graph.row(limb, s0)))
            mask = int(graph.edge_masks(limb, s0, np.array([s1]))[0])
            far = np.linalg.norm(graph.base_in_world[s1] - graph.base_in_world[s0]) > 0.1
            if mask and far:
                break
        bit = int(rng.choice([b for b in range(16) if mask >> b & 1]))
        stances = [tuple(graph.points[s].tolist()) for s in (s0, s1)]
        postures = join(*(graph.posture(stance) for stance in stances))
        edge = graph.edge(State(stances[0], (1 << bit, 1 << bit)), stances[1], postures)
        point = stances[0][limb]
        ends = (
            graph.base_in_world[s0],
            graph.base_axes_in_world[s0],
            graph.base_in_world[s1],
            graph.base_axes_in_world[s1],
        )
        path = path_between(ends, edge.kind, graph.solver.grasps["point"][point])
        places = np.linspace(0.0, 1.0, samples)
        joints = held_joints(graph, limb, point, bit & 7, path, places)
        return cls(graph, limb, point, bit & 7, path, joints)

    @property
    def moves(self):
        """What the limb does, a row of `LimbMotion`."""
        flange = self.graph.solver.grasps["flange"][self.point]
        return holding(self.limb, self.branch, flange["position"], flange["rotation"])

    def world(self):
        """Ends of its capsules in the world, shape (k, c, 2, 3)."""
        where, turned = base_poses(self.path, np.linspace(0.0, 1.0, len(self.joints)))
        return np.array([
            w + ends @ r.T
            for w, r, ends in zip(where, turned, in_body(self.limb, self.joints), strict=True)
        ])  # fmt: skip

    def standing(self, clearance, boxes=()):
        """What the compiled check says of it, boxes, body and the limb itself."""
        room = motion(self.path, (0.0, 1.0), self.moves, compared=("boxes", "body"))
        return answer(room, clearance, boxes)

    def meeting(self, clearance, mover, robot=SHAPES.robot, corner=None):
        """What the compiled check says of it and another limb that moves meanwhile.

        In a line, or round a corner: base parameter and joint angles of the mover, shape (7,).
        """
        room = motion(self.path, (0.0, 1.0), self.moves, mover, ("meeting",))
        if corner is not None:
            round_corner(room, corner[0], np.zeros(6), corner[1:])
        return answer(room, clearance, robot=robot)

    def joints_at(self, places):
        """Its joint angles at places of the base path, from 0 on, shape (k, 6)."""
        return held_joints(self.graph, self.limb, self.point, self.branch, self.path, places)


def with_shifted_mount(limb, offset):
    """The robot, a row of `Robot`, with the mount of a limb shifted in the body frame [m]."""
    robot = SHAPES.rows.copy()[0]
    robot["limbs"][limb]["mount"]["position"] += offset
    return robot


def held_joints(graph, limb, point, branch, path, places):
    """Joint angles of a limb that holds at places of a base path, from 0 on, shape (k, 6)."""
    out = Angles.rows(len(places))
    bases = poses(*base_poses(path, places))
    flange = graph.solver.grasps["flange"][point : point + 1]
    reference = Angles.row()
    assert joints_along(SHAPES.rows, limb, bases, flange, branch, reference, out) == len(places)
    return out["q"]


AT_ORIGIN = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


def verdicts(check, least):
    """Whether a motion is called clear whose least distance is 0.8 and 1.2 times the clearance.

    The check takes a clearance [m].
    """
    return [check(least / share) == CLEAR for share in (0.8, 1.2)]


class Limb:
    """Distances of limb 0 from itself, body and mounts and, if wanted, from others."""

    def __init__(self, other=False, boxes=()):
        self.ruler = Ruler(ROBOT, boxes)
        names = self.ruler.shapes

        def counts(*pair):
            there = [names[g] for g in pair]
            moving = [name for name in there if name.startswith("limb0/") and "/base/" not in name]
            apart = [name for name in there if name.startswith("limb1/") and "/base/" not in name]
            return moving and (other or not apart)

        self.ruler.pairs = [pair for pair in self.ruler.pairs if counts(*pair)]

    def nearest(self, configurations, grasps=()):
        """Least distance over some configurations, below 0.5 m, and what limb 0 is nearest to."""
        best = (0.5, "")
        for here in configurations:
            for gap, first, second in self.ruler.measured(here, grasps, best[0]):
                shape = first if first.startswith("limb0/") and "/base/" not in first else second
                if shape.startswith("limb0/") and "/base/" not in shape:
                    best = min(best, (gap, second if shape == first else first))
        return best


def kind_of(name):
    """Body, a mount, another limb, or the hand or the arm of limb 0 itself."""
    if "/base/" in name or not name.startswith("limb0/"):
        return "mount" if "/base/" in name else name.split("/")[0]
    return "arm" if name.split("/")[1] in ("shoulder", "upper_arm", "forearm") else "hand"


class Spheres(NamedTuple):
    """Spheres in which limb 0, mounts and body reach farthest in any direction, at k moments."""

    centres: np.ndarray  # (k, n, 3)
    radii: np.ndarray  # (n,)

    @classmethod
    def of(cls, moments, still=False, containing=False):
        """The body as its corners or, if `containing`, as the capsules that the checks take for it.

        Only the limb if `still`.
        """
        mounts, mount_radius = SHAPES.mounts["ends"], SHAPES.mounts["radius"]
        half = SHAPES.robot["half"]
        body, thick = np.array(list(product((-1.0, 1.0), repeat=3))) * half, 0.0
        if containing:
            around = SHAPES.robot["around"][:4]
            body, thick = around["ends"].reshape(-1, 3), around["radius"][0]
        fixed = np.zeros((0, 3)) if still else np.concatenate([mounts.reshape(-1, 3), body])
        centres = []
        for here in moments:
            base = Rotation.from_quat(here[1], scalar_first=True).as_matrix()
            limb = capsule_ends(ROBOT, SHAPES, here)[0].reshape(-1, 3)
            centres.append(np.concatenate([limb, here[0] + fixed @ base.T]))
        radii = np.concatenate(
            [np.repeat(RADII, 2), np.repeat(mount_radius, 2), np.full(len(body), thick)]
        )
        return cls(np.array(centres), radii[: centres[0].shape[0]])

    def farthest(self, direction):
        """Where they reach farthest in a direction: point, moment and kind of shape."""
        heights = self.centres @ direction + self.radii
        k, c = np.unravel_index(int(np.argmax(heights)), heights.shape)
        kind = "limb" if c < 14 else "mount" if c < 18 else "body"
        return self.centres[k, c] + self.radii[c] * direction, int(k), kind
