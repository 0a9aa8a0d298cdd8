"""Rounded corners: smooth, as they were checked, and nowhere closer than the clearance."""

import numpy as np
import pytest
from coal_ruler import Ruler, obstacles
from compiled import called
from limb_motions import REST, ROBOT, at_corner, motion, round_corner, swinging

from mlivr_gym import Box
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.sweep import set_joints
from mlivr_gym.motion.commitment import edges_along
from mlivr_gym.motion.knots import joint_path_along
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.motion.swings import SwingFinder, rounded_lines, rounded_parts

CLEARANCE = 0.02


def random_run(rng, lines):
    """A run whose corners take half of each line at most."""
    knots = np.column_stack([np.sort(rng.uniform(size=lines + 1)), rng.normal(size=(lines + 1, 6))])
    return knots, rounded_lines(knots, rng.uniform(0.1, 0.5, (lines - 1, 2)))


@pytest.mark.parametrize("lines", [1, 2, 4])
def test_a_run_is_smooth_up_to_its_second_derivative(lines):
    """Differences of third order fall with the step; at a corner that jumps they would not.

    Between the breaks the curve is a polynomial of degree 4 at most: its fifth differences vanish.
    """
    knots, run = random_run(np.random.default_rng(lines), lines)
    np.testing.assert_allclose(run.at(np.array([0.0, 1.0])), knots[[0, -1]], atol=1e-12)
    jumps = []
    for count in (2001, 4001):
        values = run.at(np.linspace(0.0, 1.0, count))
        second = np.diff(values, 2, axis=0) * (count - 1) ** 2
        jumps.append(np.abs(np.diff(second, axis=0)).max())
    assert jumps[1] < 0.6 * jumps[0] + 1e-5
    for first, last in zip(run.breaks[:-1], run.breaks[1:], strict=True):
        assert np.abs(np.diff(run.at(np.linspace(first, last, 12)), 5, axis=0)).max() < 1e-9


def test_a_run_rounds_the_corner_that_the_sweep_checks():
    """Of two lines that are corner all along, at the shares of that corner."""
    rng = np.random.default_rng(0)
    knots = rng.normal(size=(3, 7))
    scratch = motion(REST, (0.0, 1.0), swinging(0, knots[0, 1:], knots[2, 1:]))
    round_corner(scratch, 0.5, knots[1, 1:])
    q = np.zeros(6)
    for t in np.linspace(0.0, 1.0, 9):
        arm = LimbShapes(ROBOT).robot
        assert called(set_joints)(arm, scratch["motion"]["first"], t, scratch, q)
        values = rounded_lines(knots, np.ones((1, 2))).at(np.array([t]))[0]
        np.testing.assert_allclose(q, values[1:], atol=1e-12)
        np.testing.assert_allclose(values, at_corner(*knots, np.array([t]))[0], atol=1e-12)


@pytest.fixture(scope="module")
def over(checked_graph, plan):
    """A step that swings through a fold, free of obstacles: its ends, base path and swing knots."""
    edges = edges_along(checked_graph, plan.motion)
    for k, edge in enumerate(edges):
        ends = StepEnds.of(checked_graph, plan.motion, k)
        path = ends.base_path(checked_graph, edge.path_kind)
        swing = plan.joint_path(k).knots[:, ends.limb][plan.joint_path(k).sigmas == 1.0]
        landing = plan.joint_path(k).knots[:, ends.limb][plan.joint_path(k).sigmas == 2.0]
        finder = SwingFinder.of(checked_graph, ends, path)
        points = ends.before[ends.limb], ends.to_point
        for found in finder.swings(swing[0], landing[0], points, edge):
            if found.kind == "over":
                corners = finder.round_corners(found.knots, np.array([1.0, 1.0]))
                if corners[1].max() == 1.0:
                    return ends, path, found.knots, corners
    raise AssertionError


def configurations(graph, over, corners):
    """Where the robot is on its swing: base position, quaternion and joints of all limbs."""
    ends, path, knots, _ = over
    parts = rounded_parts(knots, corners)
    moved = joint_path_along(graph, ends, path, parts).samples(120)
    chosen = np.flatnonzero(moved.phase == 1)
    return [
        (moved.base_positions[k], moved.base_quaternions[k], moved.joint_positions[k])
        for k in chosen
    ]


def in_the_corner(graph, over):
    """A small box on the rounded corner, as far from the lines as a limb's shape goes there."""
    shapes, (ends, _, _, corners) = LimbShapes(ROBOT), over

    def places(rounded):
        here = configurations(graph, over, rounded)
        return np.array([capsule_ends(ROBOT, shapes, each) for each in here])

    lines = places(np.zeros_like(corners)).reshape(-1, 2, 3)
    a, along = lines[:, 0], lines[:, 1] - lines[:, 0]
    longest = np.maximum((along**2).sum(axis=1), 1e-12)
    radii, best = np.resize(shapes.radii, len(lines)), (-np.inf, None)
    for point in places(corners)[30:91:5, ends.limb].reshape(-1, 3):
        place = np.clip(((point - a) * along).sum(axis=1) / longest, 0.0, 1.0)
        away = np.linalg.norm(a + place[:, None] * along - point, axis=1) - radii
        best = max(best, (float(away.min()), tuple(point.tolist())))
    return Box("thin", "obstacle", best[1], (0.005,) * 3)


def test_a_corner_is_rounded_only_as_far_as_the_clearance_allows(checked_graph, over):
    """A box in the corner, clear of the lines: by coal the clearance is kept all along the swing.

    On the largest rounding, which is taken where nothing stands, it is not.
    """
    graph, (ends, path, knots, largest) = checked_graph, over
    box = in_the_corner(graph, over)
    with obstacles(graph, box):
        finder = SwingFinder.of(graph, ends, path)
        assert finder.is_clear(knots)
        found = finder.round_corners(knots, np.array([1.0, 1.0]))
    assert (found[1] < largest[1]).all()
    ruler = Ruler(ROBOT, [box])

    def least(corners):
        gaps = (ruler.measured(here) for here in configurations(graph, over, corners))
        return min((gap for each in gaps for gap, *pair in each if box.id in pair), default=1.0)

    assert least(largest) < CLEARANCE
    assert least(found) >= CLEARANCE - 1e-4
