"""The rule of a step, angles above a point, departures, and steps by their plain definition."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from branches import arm_of, solutions
from compiled import called
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from paper import NO_COLLISIONS
from plain_checks import PlainChecks, members
from plain_steps import NO_EDGE, PlainStep
from random_steps import asked, neighbouring_points, two_stances

from mlivr_gym import Box, Limb, robot_spec, stance_graph
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.collisions.limb_shapes import LimbShapes
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.kinematics.chain import in_window
from mlivr_gym.kinematics.grasps import grasp_rows
from mlivr_gym.kinematics.limb import Angles
from mlivr_gym.kinematics.poses import pose
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.rigid import rigid
from mlivr_gym.stances.obstacles import OBSTACLE_CELL_EDGE
from mlivr_gym.transitions.departures import OFF_NORMAL, Departure, departure_of
from mlivr_gym.transitions.grasp_poses import (
    angles_above,
    folded,
    line_end,
)
from mlivr_gym.transitions.records import StepRecord
from mlivr_gym.transitions.rule import can_release, kept_on_edge

SHARES = np.linspace(0.0, 1.0, 11)


def departures(graph, count, seed):
    """Limb, base, grasp, and the knots and flips of a departure on every branch of random nodes."""
    points = neighbouring_points(graph, count, seed)
    postures = graph.postures(points)
    nodes = np.flatnonzero(graph.is_node(postures))
    for s in nodes:
        for limb in range(graph.limbs):
            grasp, base = graph.solver.grasps[points[s, limb]], postures.base_rows[s]
            for branch in range(8):
                if int(postures.branch_sets[s, limb]) >> branch & 0x101:
                    to = Departure.row()
                    flips = departure_of(graph.checks.robots, limb, base, grasp, branch, to)
                    yield limb, base, grasp, to["knots"]["q"][: int(to["pieces"]) + 1], int(flips)


def flange_in_world(spec, limb, base, q):
    """Frame of a limb's flange in the world, shape (4, 4)."""
    mount = rigid(spec.mount_rotations[limb], spec.mount_positions[limb])
    frame = rigid(base["rotation"], base["position"])
    return frame @ mount @ link_frames(spec.every_limb[limb], q)[6]


@pytest.mark.parametrize("robot", ["mlivr2", "mlivr3", "mlivr2-iiwa"])
def test_a_limb_departs_along_the_normal(small_map, robot):
    """By forward kinematics, at samples of each piece; the flange keeps its direction at knots."""
    graph, done = stance_graph(small_map, robot), 0
    for limb, base, grasp, knots, flips in departures(graph, 400, 1):
        if not flips:
            continue
        flange, lift = grasp["flange"], graph.robot.lift
        start, normal = flange["position"], flange["rotation"][:, 2]
        for k, q in enumerate(knots):
            frame = flange_in_world(graph.robot, limb, base, q)
            there = start - lift * k / (len(knots) - 1) * normal
            np.testing.assert_allclose(frame[:3, 3], there, atol=1e-8)
            np.testing.assert_allclose(frame[:3, 2], normal, atol=1e-8)
        for first, last in pairwise(knots):
            assert np.abs(last - first).max() < 1.0
            for s in SHARES:
                frame = flange_in_world(graph.robot, limb, base, first + s * (last - first))
                away = frame[:3, 3] - start
                across = away - (away @ normal) * normal
                assert np.linalg.norm(across) <= 1.02 * OFF_NORMAL
        done += 1
        if done == 60:
            return
    assert done > 20


def test_knots_stay_in_the_windows_with_each_flip_that_is_kept(small_map):
    """Narrow windows of all joints; flip 1 turns joint 6 by half a turn on every knot."""
    limits = ((-2.0, 2.0),) * 6
    limb = Limb(joint_limits=limits, window_starts=(-2.0,) * 6)
    graph = stance_graph(small_map, replace(robot_spec("mlivr2"), limb=limb))
    told = {0: 0, 1: 0, 2: 0}
    for _, _, _, knots, flips in departures(graph, 600, 2):
        kept = []
        for flip in range(2):
            turned = knots + np.array([0, 0, 0, 0, 0, np.pi * flip])
            wound = turned + 2.0 * np.pi * np.arange(-2, 3)[:, None, None]
            if (np.abs(wound) <= 2.0 + 1e-6).all(axis=1).any(axis=0).all():
                kept.append(flip)
        assert [flip for flip in range(2) if flips >> 8 * flip & 0xFF] == kept
        told[len(kept)] += 1
    assert min(told[1], told[2]) > 0


TURNS = 2.0 * np.pi * np.arange(-12, 13)
SPEC = robot_spec("mlivr2")
ROBOT = LimbShapes(SPEC)
ANGLE = st.floats(-12.0, 12.0)
JOINTS = st.lists(ANGLE, min_size=6, max_size=6).map(np.array)


def angles(q):
    out = Angles.row()
    out["q"] = q
    return out


@given(ANGLE, st.floats(-9.0, 9.0))
@settings(deadline=None)
def test_one_winding_of_an_angle_lies_in_a_window(angle, low):
    assume(np.abs(angle + TURNS - low).min() > 1e-5)
    inside = [turn for turn in angle + TURNS if low <= turn < low + 2.0 * np.pi]
    assert called(in_window)(angle, low) == pytest.approx(inside[0], abs=1e-9)
    assert len(inside) == 1


@pytest.mark.parametrize("off", [-1e-9, 0.0, 1e-9])
@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_noise_does_not_choose_the_winding_where_a_window_begins(off, turns):
    low = -0.75 * np.pi
    found = called(in_window)(low + off + 2.0 * np.pi * turns, low)
    assert found == pytest.approx(low, abs=1e-8)


@given(JOINTS, JOINTS)
@settings(deadline=None)
def test_a_line_ends_at_the_angles_with_the_tool_at_the_nearest_half_turn(first, last):
    off = np.sort(np.abs(last[5] + 0.5 * TURNS - first[5]))
    assume(off[1] - off[0] > 1e-6)
    to = Angles.row()
    found = called(line_end)(angles(first), angles(last), to)
    tool = min(last[5] + 0.5 * TURNS, key=lambda turn: abs(turn - first[5]))
    np.testing.assert_allclose(to["q"], [*last[:5], tool], atol=1e-9)
    assert found == pytest.approx(np.abs(last - first)[:5].max(), abs=1e-9)


@given(ANGLE, st.integers(0, len(SPEC.folds) - 1))
@settings(deadline=None)
def test_a_fold_is_that_of_the_robot_in_its_windows(tool, fold):
    to, windows = Angles.row(), SPEC.limb.windows
    called(folded)(ROBOT.robot, fold, tool, to)
    np.testing.assert_allclose(np.exp(1j * to["q"][:5]), np.exp(1j * np.array(SPEC.folds[fold])))
    assert to["q"][5] == tool
    assert (to["q"][:5] >= windows[:5, 0]).all()
    assert (to["q"][:5] <= windows[:5, 1]).all()


@pytest.mark.parametrize("i", [0, 1])
@pytest.mark.parametrize("seed", range(2))
def test_angles_above_a_point_put_the_flange_the_lift_off_along_the_normal(i, seed):
    """They exist where inverse kinematics has a solution there, and reach it."""
    rng = np.random.default_rng(seed)
    mount, origin = SPEC.mount_rotations[i], SPEC.mount_positions[i]
    frame = link_frames(SPEC.limb, rng.uniform(-np.pi, np.pi, 6))[6]
    axes = mount @ frame[:3, :3]
    normal, rail = -axes[:, 2], axes[:, 0]
    point = origin + mount @ frame[:3, 3] - (SPEC.tool_length + SPEC.lift) * normal
    grasp = grasp_rows(point[None], normal[None], rail[None], SPEC.tool_length)[0]
    base, to = pose(np.zeros(3), np.eye(3)), Angles.row()
    branch_set, _ = solutions(arm_of(SPEC.limb), frame[:3, 3], frame[:3, :3], 0.0)
    assert branch_set
    for branch in range(8):
        found = angles_above(ROBOT.rows, i, base, grasp, branch, to)
        assert found == bool(branch_set >> branch & 1)
        if found:
            reached = link_frames(SPEC.limb, to["q"])[6]
            np.testing.assert_allclose(reached, frame, atol=1e-7)
            assert (to["q"] >= SPEC.limb.windows[:, 0] - 1e-5).all()
            assert (to["q"] <= SPEC.limb.windows[:, 1]).all()


BRANCH_SET = st.integers(0, 0xFFFF)
"""Sets of branches and flips."""


def branches(branch_set):
    return {bit for bit in range(16) if branch_set >> bit & 1}


@given(BRANCH_SET, BRANCH_SET)
@example(1, 2)
@example(1 << 15, 1 << 15)
def test_a_limb_may_move_if_it_may_be_on_a_branch_on_which_it_can_be_released(
    branch_set, releasable
):
    assert can_release(branch_set, releasable) is bool(branches(branch_set) & branches(releasable))


@given(BRANCH_SET, BRANCH_SET)
@example(1, 2)
@example(1 << 15, 1 << 15)
def test_a_limb_that_holds_keeps_the_branches_that_it_may_be_on_and_the_edge_serves(
    branch_set, edge
):
    kept = kept_on_edge(branch_set, edge)
    assert branches(kept) == branches(branch_set) & branches(edge)
    assert kept <= 0xFFFF


@pytest.fixture(scope="module", params=[2, 3, 4])
def small(request, small_map):
    """Graphs of robots of two, three and four limbs."""
    robot = f"mlivr{request.param}"
    return stance_graph(small_map, robot), stance_graph(small_map, robot, NO_COLLISIONS)


def same_release(ours, truth):
    assert members(ours["branches"]) == truth.pairs
    assert {fold for fold in range(8) if int(ours["folds"]) >> fold & 1} == truth.folds
    if truth.folds:
        assert ours["root"] == truth.root
        assert {b: int(ours["via"][b]) for b in truth.via} == truth.via


def same_edge(step, truth, limbs):
    assert {i: members(step["kept"][i]) for i in limbs} == (truth.kept or {i: set() for i in limbs})


def some_branches(graph, rng, few):
    """Bits that each limb may be on: all, or a few."""
    return [int(rng.integers(1, ALL + 1)) if few else ALL for _ in range(graph.limbs)]


def test_releases_and_steps_are_those_of_the_plain_definition(small):
    graph, rng = small[0], np.random.default_rng(8)
    kinds = dict.fromkeys(("none", "folded", "line", "joined"), 0)
    for k in range(40):
        limb, before, after = two_stances(graph, rng)
        given = some_branches(graph, rng, few=k % 2 == 1)
        stances, step, able = asked(graph, limb, before, after, given)
        plain = PlainChecks(graph, stances)
        releases = [[plain.release(s, i) for i in range(graph.limbs)] for s in (0, 1)]
        for s in (0, 1):
            for i in range(graph.limbs):
                same_release(stances.releases[s, i], releases[s][i])
        of_step = PlainStep(plain, limb, 0, 1)
        edge = of_step.check(releases)
        assert able or edge == NO_EDGE
        same_edge(step, edge, of_step.held)
        kinds["none"] += edge == NO_EDGE
        kinds["line"] += edge.line_branches >= 0
        kinds["folded"] += bool(edge.kept) and edge.line_branches < 0
        kinds["joined"] += any(one.pairs and not one.folds for both in releases for one in both)
    assert min(kinds.values()) > 0


def test_steps_without_collisions_are_those_of_the_plain_definition(small):
    graph, rng = small[1], np.random.default_rng(10)
    for k in range(60):
        limb, before, after = two_stances(graph, rng)
        given = some_branches(graph, rng, few=k % 2 == 1)
        stances, step, able = asked(graph, limb, before, after, given)
        of_step = PlainStep(PlainChecks(graph, stances), limb, 0, 1)
        edge = of_step.check()
        same_edge(step, edge, of_step.held)
        assert able or edge == NO_EDGE


def test_looking_at_steps_keeps_at_least_what_checking_them_keeps(small_map):
    """Beside a box, of what is kept without it; most of what goes is seen.

    What is kept beside an obstacle is what is kept beside it as a box of the map.
    """
    graph, rng, seen, gone = stance_graph(small_map), np.random.default_rng(5), 0, 0
    for _ in range(60):
        limb, before, after = two_stances(graph, rng)
        support, (stances, step, _) = 1 - limb, asked(graph, limb, before, after)
        if not step["kept"][support]:
            continue
        if rng.random() < 0.5:
            stances.releases["folds"] = 0  # so that the limb swings along a line
        for half in (0.1, *rng.uniform(0.01, 0.05, 8)):
            centre = stances.base["position"].mean(axis=0) + rng.uniform(-0.5, 0.5, 3)
            graph.add_obstacles([Box.between("box", "obstacle", centre - half, centre + half)])
            looked, checked, in_map = (step.copy().reshape(1) for _ in range(3))
            worlds = (graph.checks.world(graph.obstacle_grid, only) for only in (True, False))
            graph.checks.look(looked, stances, next(worlds))
            graph.checks.check(checked, stances, next(worlds))
            grid = box_grid((*graph.grasp_map.boxes, *graph.obstacles), OBSTACLE_CELL_EDGE)
            graph.checks.check(in_map, stances, graph.checks.world(None)._replace(boxes=grid))
            graph.remove_obstacles()
            assert checked["kept"].tolist() == in_map["kept"].tolist()
            most, kept = (int(one["kept"][0, support]) for one in (looked, checked))
            assert most & ~int(step["kept"][support]) == 0
            assert kept & int(step["kept"][support]) & ~most == 0
            gone += kept == 0
            seen += most == 0
    assert gone >= seen > 0.5 * gone > 5


def test_a_robot_of_four_limbs_that_has_turned_by_one_keeps_the_same(small_map):
    graph, rng, kept = stance_graph(small_map, "mlivr4"), np.random.default_rng(6), 0
    for _ in range(80):
        limb, before, after = two_stances(graph, rng)
        _, step, _ = asked(graph, limb, before, after)
        for turn in (1, 2, 3):
            turned = (tuple(np.roll(stance, -turn).tolist()) for stance in (before, after))
            _, other, _ = asked(graph, (limb - turn) % 4, *turned)
            assert np.array_equal(np.roll(step["kept"][:4], -turn), other["kept"][:4])
        kept += step["kept"].any()
    assert kept > 10


@pytest.mark.parametrize(
    ("robot", "settings"), [("mlivr3", None), ("mlivr4", None), ("mlivr4", NO_COLLISIONS)]
)
def test_steps_keep_at_most_what_the_plain_definition_says(small_map, robot, settings):
    graph, rng = stance_graph(small_map, robot, settings), np.random.default_rng(3)
    checks, kinds = graph.checks, dict.fromkeys(("none", "less", "all"), 0)
    for _ in range({3: 24, 4: 12}[graph.limbs]):
        limb, before, after = two_stances(graph, rng)
        stances, step, _ = asked(graph, limb, before, after)
        world, most, back = checks.world(None), *StepRecord.rows(2)[:, None]
        for one, ends in ((most, (0, 1)), (back, (1, 0))):
            one["limb"], (one["before"], one["after"]), one["kept"] = limb, ends, ALL
            checks.relax(one, stances, world)
        supports = [i for i in range(graph.limbs) if i != limb]
        both = [one["kept"][0, supports] for one in (most, back)]
        if all(one.all() for one in both):
            assert (both[0] == both[1]).all()
        else:
            assert not any(one.all() for one in both)
        plain = PlainChecks(graph, stances)
        releases = None
        if settings is None:
            releases = [[plain.release(s, i) for i in range(graph.limbs)] for s in (0, 1)]
        of_step = PlainStep(plain, limb, 0, 1)
        found = {i: members(most["kept"][0, i]) for i in of_step.held}
        assert found == of_step.most(releases)
        assert (step["kept"] & ~most["kept"][0] == 0).all()
        for _ in range(8):
            few = [int(rng.integers(1, ALL + 1)) for _ in range(graph.limbs)]
            _, kept, _ = asked(graph, limb, before, after, few)
            assert (kept["kept"] & ~most["kept"][0] == 0).all()
        standing = of_step.alone(collisions=False)
        kind = "all" if found == standing else "less" if any(found.values()) else "none"
        kinds[kind] += 1
    assert kinds["all"] > 0
    assert settings is not None or kinds["none"] > 0
