"""Limbs over k moments: capsule ends in the body frame, limbs that hold, how far two are apart."""

from typing import NamedTuple

import numpy as np
import pytest
from coal_ruler import apart, capsule
from scipy.optimize import brentq

from mlivr_gym import robot_spec
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.distances import segments_apart
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.swept_hold import hold_free
from mlivr_gym.kinematics.holding import base_path
from mlivr_gym.kinematics.path_following import joints_along
from mlivr_gym.stances.stance_graph import join

ROBOT = robot_spec("mlivr2")
SHAPES = LimbShapes(ROBOT)
RADII = SHAPES.arrays[2]
MOUNTS = ROBOT.mount_rotations, ROBOT.mount_positions
NO_LIMBS = np.empty((0, len(SHAPES), 2, 3))
NOBODY = np.zeros(6), np.zeros(6), MOUNTS[0][0], MOUNTS[1][0]
"""A mover that is not looked at."""


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
        gap = np.sqrt(segments_apart(*(tuple(v) for v in axes)))
        best = min(best, (gap - RADII[i] - RADII[j], (int(k), int(i), int(j))))
    return best


def by_coal(first, second, at):
    k, i, j = at
    return apart(capsule(RADII[i], *first[k, i]), capsule(RADII[j], *second[k, j]))


def shift_to(first, second, direction, gap):
    """A shift of the second limb after which its least distance from the first is `gap` [m].

    From where both forearms cross half way it goes in a direction until they are that far apart.
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


class Hold(NamedTuple):
    """A limb that holds a point on a branch while the base follows a path, at k moments."""

    graph: object
    limb: int
    point: int
    branch: int
    path: tuple
    joints: np.ndarray  # (k, 6)

    @classmethod
    def random(cls, graph, rng, samples=151):
        """What a random edge of a graph holds on."""
        while True:
            s0, limb = int(rng.integers(len(graph))), int(rng.integers(2))
            s1 = int(rng.choice(graph.row(limb, s0)))
            mask = int(graph.edge_masks(limb, s0, np.array([s1]))[0])
            far = np.linalg.norm(graph.position[s1] - graph.position[s0]) > 0.1
            if mask and far:
                break
        bit = int(rng.choice([b for b in range(16) if mask >> b & 1]))
        stances = [tuple(graph.points[s].tolist()) for s in (s0, s1)]
        postures = join(*(graph.posture(stance) for stance in stances))
        way = graph.way(*stances, 1 - limb, postures, [1 << bit, 1 << bit])
        point = stances[0][limb]
        path = (
            graph.position[s0],
            graph.rotation[s0],
            graph.position[s1],
            graph.rotation[s1],
            way.kind,
        )
        path = (*path, graph.solver.points[point])
        return cls(
            graph,
            limb,
            point,
            bit & 7,
            path,
            held_joints(graph, limb, point, bit & 7, path, samples),
        )

    @property
    def grip(self):
        return self.graph.solver.flanges[self.point], self.graph.solver.tools[self.point]

    def world(self):
        """Ends of its capsules in the world, shape (k, c, 2, 3)."""
        where, turned = base_path(*self.path, np.linspace(0.0, 1.0, len(self.joints)))
        return np.array([
            w + ends @ r.T
            for w, r, ends in zip(where, turned, in_body(self.limb, self.joints), strict=True)
        ])  # fmt: skip

    def answer(self, collision_model, mover, parts):
        """What the compiled check says of `parts`, given `Bodies.arrays`.

        The mover's joint angles at both ends, and its mount.
        """
        lengths, mounts = ROBOT.limb.lengths, (MOUNTS[0][self.limb], MOUNTS[1][self.limb])
        shapes, _, hand, fixed, world, clearance, _ = collision_model
        return hold_free(
            self.limb, *self.grip, self.path, 0.0, 1.0, self.branch, lengths, *mounts, *mover,
            shapes, hand, fixed, world, clearance, True, parts,
        )  # fmt: skip


def held_joints(graph, limb, point, branch, path, samples):
    """Joint angles of a limb that holds along a base path, shape (samples, 6)."""
    out = np.empty((samples, 6))
    poses = base_path(*path, np.linspace(0.0, 1.0, samples))
    grip = graph.solver.flanges[point][None], graph.solver.tools[point][None]
    mount = MOUNTS[0][limb], MOUNTS[1][limb], ROBOT.limb.lengths
    assert joints_along(*grip, *poses, *mount, branch, np.zeros(6), out) == samples
    return out
