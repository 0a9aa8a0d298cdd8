"""Pairs that are not compared cannot touch; the capsules of the base contain body and mounts."""

import itertools

import numpy as np
from compiled import called

from mlivr_gym import Box, robot_spec
from mlivr_gym.collisions.against_boxes import GraspSurface, compare_base_with_boxes
from mlivr_gym.collisions.allowed_collisions import ALLOWED_COLLISIONS
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.distances import CLEAR, OBSTACLE, segments_distance
from mlivr_gym.collisions.joint_lines import BaseMove
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.robot.capsules import LINKS

ROBOT = robot_spec("mlivr2")


SHAPES = LimbShapes(ROBOT)


def test_links_that_are_not_compared_never_meet():
    """No posture brings uncompared links two joints apart closer than touching."""
    pairs = [(row.first, row.second) for row in ALLOWED_COLLISIONS if row.checked]
    left_out = {tuple(sorted(map(LINKS.index, pair))) for pair in pairs}
    compared = {tuple(SHAPES.links[[i, j]].tolist()) for i, j in SHAPES.pairs}
    rng = np.random.default_rng(1)
    least = dict.fromkeys(left_out, np.inf)
    for _ in range(3000):
        here = (np.zeros(3), np.array([1.0, 0, 0, 0]), rng.uniform(-np.pi, np.pi, (2, 6)))
        ends = capsule_ends(ROBOT, SHAPES, here)[0]
        for i, j in itertools.combinations(range(len(SHAPES)), 2):
            pair = tuple(SHAPES.links[[i, j]].tolist())
            if pair in left_out and pair not in compared:
                gap = segments_distance(
                    tuple(ends[i, 0]),
                    tuple(ends[i, 1] - ends[i, 0]),
                    tuple(ends[j, 0]),
                    tuple(ends[j, 1] - ends[j, 0]),
                )
                least[pair] = min(least[pair], gap - SHAPES.radii[i] - SHAPES.radii[j])
    assert min(least.values()) > 0.0


def test_what_moves_with_the_base_contains_body_and_mounts():
    """A box of 1 mm anywhere in the body or a mount is reported; one 22 cm away is not."""
    robot, rng = robot_spec("mlivr3"), np.random.default_rng(0)
    shapes = LimbShapes(robot)
    mounts, radius = shapes.mounts["ends"], shapes.mounts["radius"]
    half, origin = shapes.robot["half"], pose(np.zeros(3), np.eye(3))

    def answer(point):
        speck = Box("speck", "obstacle", tuple(point), (5e-4, 5e-4, 5e-4))
        grid, rests, nothing = box_grid((speck,)), BaseMove.row(), GraspSurface.row()
        return called(compare_base_with_boxes)(shapes.robot, origin, rests, 0.0, grid, 0.0, nothing)

    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * half
    inside = [*corners, *rng.uniform(-half, half, (200, 3))]
    for m in range(len(mounts)):
        share, out = rng.uniform(size=(50, 1)), rng.normal(size=(50, 3))
        out *= radius[m] * rng.uniform(size=(50, 1)) / np.linalg.norm(out, axis=1, keepdims=True)
        inside += [*(mounts[m, 0] + share * (mounts[m, 1] - mounts[m, 0]) + out)]
    assert all(answer(point) == OBSTACLE for point in inside)
    outside = rng.normal(size=(200, 3))
    outside *= 0.22 / np.linalg.norm(outside, axis=1, keepdims=True)
    assert all(answer(point) == CLEAR for point in outside)
