"""Limbs over k moments, capsule ends in the body frame, and how far two of them are apart."""

import numpy as np
import pytest
from coal_ruler import apart, capsule
from scipy.optimize import brentq

from mlivr_gym import robot_spec
from mlivr_gym.contacts import capsule_ends
from mlivr_gym.distance_kernels import segments_apart
from mlivr_gym.limb_shapes import LimbShapes

ROBOT = robot_spec("mlivr2")
SHAPES = LimbShapes(ROBOT)
RADII = SHAPES.arrays[2]


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
    """Least distance between the capsules of two limbs over k moments, ends (k, c, 2, 3): value, moment and pair."""
    # Distances of middles tell which pairs are worth a look.
    reach = (
        np.linalg.norm(np.ptp(first, axis=2), axis=-1)[:, :, None]
        + np.linalg.norm(np.ptp(second, axis=2), axis=-1)[:, None]
    )
    rough = np.linalg.norm(first.mean(axis=2)[:, :, None] - second.mean(axis=2)[:, None], axis=-1) - 0.5 * reach
    rough -= RADII[:, None] + RADII[None]
    best = (np.inf, None)
    for index in np.argsort(rough, axis=None):
        k, i, j = np.unravel_index(int(index), rough.shape)
        if rough[k, i, j] > best[0]:
            break
        p, q = first[k, i], second[k, j]
        gap = np.sqrt(segments_apart(tuple(p[0]), tuple(p[1] - p[0]), tuple(q[0]), tuple(q[1] - q[0])))
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
    root = brentq(lambda x: least_apart(first, second + crossed + x * direction)[0] - gap, x - 0.05, x, xtol=1e-6)
    shift = crossed + root * direction
    assert by_coal(first, second + shift, least_apart(first, second + shift)[1]) == pytest.approx(gap, abs=1e-4)
    return shift
