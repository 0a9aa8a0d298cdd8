"""Limbs that hold are called clear at 1.2 times the clearance and never at 0.8 times.

Coal is the ruler; see `test_sweep_swings` for how obstacles are placed.
"""

from collections import Counter

import numpy as np
import pytest
from coal_ruler import PLATE, ROD, apart, capsule, in_front, solid
from held_paths import path_between
from limb_motions import (
    AT_ORIGIN,
    HAND,
    RADII,
    Hold,
    Limb,
    Spheres,
    answer,
    at_corner,
    by_coal,
    draw,
    held_joints,
    holding,
    in_body,
    kind_of,
    least_apart,
    motion,
    shift_to,
    swinging,
    verdicts,
    with_shifted_mount,
)

from mlivr_gym.collisions.distances import CLEAR

CLEARANCE = 0.02


NEAR, FAR = 0.8 * CLEARANCE, 1.2 * CLEARANCE


def test_a_limb_that_holds_keeps_clear_of_the_robot_and_no_more(small_checked_graph):
    """Of itself, the body and the mounts, while the base follows a path."""
    rng, limb, met = np.random.default_rng(4), Limb(), Counter()
    while sum(met.values()) < 20:
        hold = Hold.random(small_checked_graph, rng, 61)
        if hold.limb == 0:
            moments = [(*AT_ORIGIN, np.array([q, np.zeros(6)])) for q in hold.joints]
            gap, other = limb.nearest(moments)
            met[kind_of(other)] += 1
            assert verdicts(hold.standing, gap) == [False, True]
    assert len(met) > 1


def test_a_limb_that_holds_keeps_the_clearance_to_boxes_and_no_more(small_checked_graph):
    """A thin obstacle before the arm that follows the base; its hand stands still."""
    rng = np.random.default_rng(1)
    for n in range(30):
        hold = Hold.random(small_checked_graph, rng)
        ends, direction = hold.world()[:, :HAND], draw(rng)
        spheres = Spheres(ends.reshape(len(ends), -1, 3), np.repeat(RADII[:HAND], 2))
        point, k, _ = spheres.farthest(direction)
        for gap in (NEAR, FAR):
            box = in_front(point, direction, gap, (PLATE, ROD)[n % 2])
            arm = [capsule(r, *axis) for r, axis in zip(RADII, ends[k], strict=False)]
            least = min(apart(shape, solid(box)) for shape in arm)
            assert least == pytest.approx(gap, abs=1e-5)
            assert (hold.standing(CLEARANCE, (box,)) == CLEAR) == (gap == FAR)


def test_a_limb_that_holds_keeps_the_clearance_to_the_one_that_swings_and_no_more(
    small_checked_graph,
):
    """The mover's mount is shifted until both limbs are 0.8 or 1.2 times the clearance apart."""
    rng, places = np.random.default_rng(2), np.linspace(0.0, 1.0, 151)
    for _ in range(6):
        hold = Hold.random(small_checked_graph, rng)
        mover = 1 - hold.limb
        start = rng.uniform(-np.pi, np.pi, 6)
        end = start + rng.uniform(-0.5, 0.5, 6)
        ours = in_body(hold.limb, hold.joints)
        theirs = in_body(mover, start + places[:, None] * (end - start))
        direction = draw(rng)
        for gap in (NEAR, FAR):
            offset = shift_to(ours, theirs, direction, gap)
            line, robot = swinging(mover, start, end), with_shifted_mount(mover, offset)
            assert (hold.meeting(CLEARANCE, line, robot) == CLEAR) == (gap == FAR)


def test_a_rounded_corner_keeps_clear_of_a_limb_that_holds_and_no_more(small_checked_graph):
    """The base is anywhere on its path at the corner."""
    rng, places = np.random.default_rng(7), np.linspace(0.0, 1.0, 301)
    for _ in range(8):
        hold = Hold.random(small_checked_graph, rng)
        mover, start = 1 - hold.limb, rng.uniform(-np.pi, np.pi, 6)
        corner, end = start + rng.uniform(-0.5, 0.5, (2, 6))
        knots = np.column_stack([[0.0, rng.uniform(), 1.0], [start, corner, end]])
        values = at_corner(*knots, places)
        ours, theirs = (
            in_body(hold.limb, hold.joints_at(values[:, 0])),
            in_body(mover, values[:, 1:]),
        )
        direction = draw(rng)
        for gap in (NEAR, FAR):
            offset = shift_to(ours, theirs, direction, gap)
            ends, robot = swinging(mover, start, end), with_shifted_mount(mover, offset)
            assert (hold.meeting(CLEARANCE, ends, robot, knots[1]) == CLEAR) == (gap == FAR)


def test_a_line_through_a_limb_that_holds_is_not_clear(small_checked_graph):
    """Random lines of the mover: clear only where coal finds the clearance at every sample."""
    rng, places = np.random.default_rng(3), np.linspace(0.0, 1.0, 201)
    answers = []
    for _ in range(40):
        hold = Hold.random(small_checked_graph, rng, 201)
        mover = 1 - hold.limb
        start, end = rng.uniform(-2.0, 2.0, (2, 6))
        ours = in_body(hold.limb, hold.joints)
        theirs = in_body(mover, start + places[:, None] * (end - start))
        _, at = least_apart(ours, theirs)
        least = by_coal(ours, theirs, at)
        clear = hold.meeting(CLEARANCE, swinging(mover, start, end)) == CLEAR
        assert not clear or least >= CLEARANCE - 1e-9
        assert clear or least < 2.0 * CLEARANCE
        answers.append(clear)
    assert 5 < sum(answers) < 35


def both_hold(graph, rng):
    """Two limbs that hold while the base moves a little without turning.

    Their joint angles, branches, path and points.
    """
    while True:
        s = int(rng.integers(len(graph)))
        points, turn = graph.points[s].tolist(), graph.base_axes_in_world[s]
        first = graph.base_in_world[s]
        path = path_between((first, turn, first + 0.08 * draw(rng), turn))
        branches = graph.branch[s].tolist()
        try:
            places = np.linspace(0.0, 1.0, 101)
            joints = [held_joints(graph, i, points[i], branches[i], path, places) for i in range(2)]
        except AssertionError:
            continue
        return joints, branches, path, points


def apart_answer(graph, branches, path, points, offset=(0.0, 0.0, 0.0)):
    """What the check says; mount and grip of the second limb shifted in the body frame."""
    room = both_holding(graph, branches, path, points, offset)
    return answer(room, CLEARANCE, robot=with_shifted_mount(1, offset))


def both_holding(graph, branches, path, points, offset=(0.0, 0.0, 0.0)):
    """The motion in which both limbs hold."""
    flanges = graph.solver.grasps["flange"][points]
    grips, tools = flanges["position"].copy(), flanges["rotation"]
    grips[1] += path["first"]["rotation"] @ offset
    limbs = [holding(i, branches[i], grips[i], tools[i]) for i in range(2)]
    return motion(path, (0.0, 1.0), *limbs, ("meeting",))


def test_two_limbs_that_hold_keep_the_clearance_and_no_more(small_checked_graph):
    """The second limb is shifted until they are 0.8 or 1.2 times the clearance apart."""
    rng, graph = np.random.default_rng(4), small_checked_graph
    for _ in range(6):
        joints, branches, path, points = both_hold(graph, rng)
        first, second = (in_body(i, joints[i]) for i in range(2))
        direction = draw(rng)
        for gap in (NEAR, FAR):
            offset = shift_to(first, second, direction, gap)
            assert (apart_answer(graph, branches, path, points, offset) == CLEAR) == (gap == FAR)


def test_both_limbs_are_followed_to_the_end_of_a_motion_that_is_clear(small_checked_graph):
    """Where they are at its end bounds how far they turn on its last interval."""
    rng, seen = np.random.default_rng(5), 0
    while seen < 4:
        joints, branches, path, points = both_hold(small_checked_graph, rng)
        room = both_holding(small_checked_graph, branches, path, points)
        if answer(room, CLEARANCE) != CLEAR:
            continue
        for name, angles in zip(("first_ahead", "second_ahead"), joints, strict=True):
            away = np.ravel(room[name])[:6] - angles[-1]
            # The tool may be held either way up: half a turn of joint 6.
            np.testing.assert_allclose(np.angle(np.exp(2j * away)), 0.0, atol=1e-8)
            assert np.abs(angles[-1] - angles[0]).max() > 1e-3
        seen += 1
