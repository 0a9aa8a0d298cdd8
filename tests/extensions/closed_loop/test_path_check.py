"""How near a box comes to a robot on its way, against coal."""

import coal
import numpy as np
import pytest
from scipy.optimize import brentq

from mlivr_gym import Box
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.extensions.closed_loop.path_check import HORIZON, TOUCH, PathCheck
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.timing import step_trajectory

HALF = 0.1

OF_LIMBS = slice(0, 14)
"""The capsules of the limbs; those of the body contain it, and are larger."""


@pytest.fixture(scope="module")
def path(checked_graph, walk):
    trajectory = step_trajectory(checked_graph, walk, 0, Limits())
    return PathCheck(checked_graph, LimbShapes(checked_graph.robot), trajectory)


def distance(axes, radii, centre):
    """The least distance of a cube from capsules, whose axes have the shape (k, c, 2, 3)."""
    cube, least = coal.Box(*(2.0 * HALF,) * 3), np.inf
    place = coal.Transform3s(np.eye(3), np.array(centre))
    for (begin, end), radius in zip(axes.reshape(-1, 2, 3), np.tile(radii, len(axes)), strict=True):
        along = end - begin
        length = np.linalg.norm(along)
        turn = coal.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), along + 1e-12)
        there = coal.Transform3s(turn.matrix(), 0.5 * (begin + end))
        result = coal.DistanceResult()
        capsule = coal.Capsule(radius, length)
        least = min(
            least, coal.distance(capsule, there, cube, place, coal.DistanceRequest(), result)
        )
    return least


def cubes_at(axes, radii, direction, targets):
    """Cubes outside the robot at some least distances from it, in one direction."""
    middle, far = axes.mean(axis=(0, 1, 2)), 2.5
    while distance(axes, radii, middle + far * direction) > min(targets):
        far -= 0.05
    for target in targets:
        away = brentq(
            lambda t, target=target: distance(axes, radii, middle + t * direction) - target,
            far, far + 0.3, xtol=1e-7,
        )  # fmt: skip
        centre = middle + away * direction
        assert distance(axes[:, OF_LIMBS], radii[OF_LIMBS], centre) < target + 1e-6
        yield Box.between("cube", "obstacle", centre - HALF, centre + HALF)


@pytest.mark.parametrize("direction", [(1.0, 0.2, 0.3), (-0.8, -0.1, 0.2)])
def test_a_path_is_blocked_by_what_is_nearer_than_the_clearance(path, checked_graph, direction):
    direction, clearance = np.array(direction), checked_graph.settings.clearance
    far, near = cubes_at(path.axes, path.radii, direction, (1.02 * clearance, 0.98 * clearance))
    assert not path.is_blocked([far], 0)
    assert path.is_blocked([near], 0)
    assert not path.is_blocked([], 0)


@pytest.mark.parametrize("shift", [(0.04, 0.0, 0.0), (0.0, -0.03, 0.03), (-0.02, 0.01, 0.0)])
def test_a_robot_beside_its_path_touches_what_is_as_near_as_a_touch(path, shift):
    """All of it is as far from its path as the base is now."""
    first = len(path.trajectory.times) // 3
    at = path.trajectory.at(np.array([first]))
    present = at.base_positions[0] + shift, at.base_quaternions[0], at.joint_positions[0]
    now = path.trajectory.times[first]
    ahead = (path.times >= now - 1e-9) & (path.times < now + HORIZON + 0.1)
    axes = path.axes[ahead] + np.array(shift)
    for cube, touches in zip(
        cubes_at(axes, path.radii, np.array([0.3, 1.0, 0.2]), (1.2 * TOUCH, 0.8 * TOUCH)),
        (False, True), strict=True,
    ):  # fmt: skip
        assert path.will_touch([cube], first, present) == touches
