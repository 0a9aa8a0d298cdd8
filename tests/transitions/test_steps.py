"""Releases and steps against their plain definition, which asks for one motion at a time."""

import numpy as np
import pytest
from paper import NO_COLLISIONS
from plain_checks import PlainChecks, members
from plain_steps import NO_EDGE, PlainStep
from random_steps import asked, two_stances

from mlivr_gym import Box, stance_graph
from mlivr_gym.collisions.box_grid import box_grid
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.stances.obstacles import OBSTACLE_CELL_EDGE


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
