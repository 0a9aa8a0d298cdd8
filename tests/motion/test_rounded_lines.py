"""Rounded corners: smooth, as they were checked, and nowhere closer than the clearance."""

from dataclasses import replace

import numpy as np
import pytest
from coal_ruler import Ruler, obstacles
from compiled import called
from limb_motions import REST, ROBOT, at_corner, motion, round_corner, swinging

from mlivr_gym import Box
from mlivr_gym.collisions.contacts import capsule_ends
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.collisions.sweep import set_joints
from mlivr_gym.kinematics.poses import quaternion
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.motion.rounded_lines import RoundedLines
from mlivr_gym.motion.swings import SwingFinder

CLEARANCE = 0.02


def random_run(rng, lines):
    """A run whose corners take half of each line at most."""
    knots = np.column_stack([np.sort(rng.uniform(size=lines + 1)), rng.normal(size=(lines + 1, 6))])
    return RoundedLines(knots, rng.uniform(0.1, 0.5, (lines - 1, 2)))


@pytest.mark.parametrize("lines", [1, 2, 4])
def test_a_run_is_smooth_up_to_its_second_derivative(lines):
    """Differences of third order fall with the step; at a corner that jumps they would not."""
    run = random_run(np.random.default_rng(lines), lines)
    np.testing.assert_allclose(run.at(np.array([0.0, 1.0])), run.knots[[0, -1]], atol=1e-12)
    jumps = []
    for count in (2001, 4001):
        values = run.at(np.linspace(0.0, 1.0, count))
        second = np.diff(values, 2, axis=0) * (count - 1) ** 2
        jumps.append(np.abs(np.diff(second, axis=0)).max())
    assert jumps[1] < 0.6 * jumps[0] + 1e-5


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
        values = RoundedLines(knots, np.ones((1, 2))).at(np.array([t]))[0]
        np.testing.assert_allclose(q, values[1:], atol=1e-12)
        np.testing.assert_allclose(values, at_corner(*knots, np.array([t]))[0], atol=1e-12)


@pytest.fixture(scope="module")
def rounded_step(checked_graph, plan):
    """A step whose swing goes through a fold, its corner as large as it may be."""
    steps = [planned_regrasp(checked_graph, plan, k) for k in range(len(plan.steps))]
    return next(step for step in steps if len(step.knots) == 3 and step.rounded[1].max() == 1.0)


def configurations(graph, regrasp, share):
    """Where the robot is on its swing: base position, quaternion and joints of all limbs."""
    path = RegraspPath(graph, regrasp)
    parts = [path.swing(k, share) for k in range(len(path.lines))]
    s = np.concatenate([part[0] for part in parts])
    joints = path.supports(s)
    joints[:, regrasp.limb] = np.concatenate([part[1] for part in parts])
    return [(p, quaternion(r), q) for p, r, q in zip(*path.base(s), joints, strict=True)]


def in_the_corner(graph, step):
    """A small box on the rounded corner, as far from the lines as a limb's shape goes there."""
    share, shapes = np.linspace(0.0, 1.0, 120), LimbShapes(ROBOT)

    def ends(rounded):
        here = configurations(graph, replace(step, rounded=rounded), share)
        return np.array([capsule_ends(ROBOT, shapes, each) for each in here])

    lines = ends(np.zeros_like(step.rounded)).reshape(-1, 2, 3)
    a, along = lines[:, 0], lines[:, 1] - lines[:, 0]
    longest = np.maximum((along**2).sum(axis=1), 1e-12)
    radii, best = np.resize(shapes.radii, len(lines)), (-np.inf, None)
    for point in ends(step.rounded)[30:91:5, step.limb].reshape(-1, 3):
        place = np.clip(((point - a) * along).sum(axis=1) / longest, 0.0, 1.0)
        away = np.linalg.norm(a + place[:, None] * along - point, axis=1) - radii
        best = max(best, (float(away.min()), tuple(point.tolist())))
    return Box("thin", "obstacle", best[1], (0.005,) * 3)


def test_a_corner_is_rounded_only_as_far_as_the_clearance_allows(checked_graph, rounded_step):
    """A box in the corner, clear of the lines: by coal the clearance is kept all along the swing.

    On the largest rounding, which is taken where nothing stands, it is not.
    """
    graph, step = checked_graph, rounded_step
    box, lengths = in_the_corner(graph, step), 1.0 / step.rounded[1]
    free = SwingFinder.of(graph, step).round_corners(step.knots, lengths)
    np.testing.assert_allclose(free, step.rounded, atol=1e-9)
    with obstacles(graph, box):
        finder = SwingFinder.of(graph, step)
        assert finder.is_clear(step.knots)
        found = replace(step, rounded=finder.round_corners(step.knots, lengths))
    assert (found.rounded[1] < step.rounded[1]).all()
    ruler, share = Ruler(ROBOT, [box]), np.linspace(0.0, 1.0, 200)

    def least(regrasp):
        gaps = (ruler.measured(here) for here in configurations(graph, regrasp, share))
        return min((gap for each in gaps for gap, *pair in each if box.id in pair), default=1.0)

    assert least(step) < CLEARANCE
    assert least(found) >= CLEARANCE - 1e-6
