"""Releases and steps against their plain definition, which asks for one motion at a time."""

import numpy as np
import pytest
from limb_motions import swinging
from paper import NO_COLLISIONS
from plain_checks import PlainChecks, members
from plain_steps import NO_EDGE, PlainStep
from random_steps import asked, two_stances

from mlivr_gym import stance_graph
from mlivr_gym.collisions.motion import SweepScratch
from mlivr_gym.compiled.bit_sets import ALL
from mlivr_gym.transitions.motions import SupportRecord, SwingCurve, curve_clear


@pytest.fixture(scope="module", params=[3, 4])
def small(request, small_map):
    """Graphs of robots of three and of four limbs."""
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
    assert int(step["line_branches"]) == truth.line_branches
    assert int(step["fold"]) == truth.fold
    if truth.kept:
        assert step["path_kind"] == truth.path_kind


def some_branches(graph, rng, given):
    """Bits that each limb may be on: all, or a few that are given."""
    return [int(rng.integers(1, ALL + 1)) if given else ALL for _ in range(graph.limbs)]


@pytest.mark.parametrize("given", [False, True])
def test_releases_and_steps_are_those_of_the_plain_definition(small, given):
    graph, rng = small[0], np.random.default_rng(8 + 11 * int(given))
    kinds = dict.fromkeys(("none", "folded", "line", "joined"), 0)
    for _ in range(40):
        limb, before, after = two_stances(graph, rng)
        wanted = some_branches(graph, rng, given)
        stances, step, able = asked(graph, limb, before, after, wanted, given)
        plain = PlainChecks(graph, stances)
        releases = [[plain.release(s, i) for i in range(graph.limbs)] for s in (0, 1)]
        for s in (0, 1):
            for i in range(graph.limbs):
                same_release(stances.releases[s, i], releases[s][i])
        of_step = PlainStep(plain, limb, 0, 1, step["pivot"], [*map(members, wanted)], given)
        assert able == any(all(on.values()) for on in of_step.on_path)
        edge = of_step.check(releases)
        same_edge(step, edge, of_step.held)
        kinds["none"] += edge == NO_EDGE
        kinds["line"] += edge.line_branches >= 0
        kinds["folded"] += edge.fold >= 0
        kinds["joined"] += any(one.pairs and not one.folds for both in releases for one in both)
    assert min(kinds.values()) > 0


@pytest.mark.parametrize("given", [False, True])
def test_steps_without_collisions_are_those_of_the_plain_definition(small, given):
    graph, rng = small[1], np.random.default_rng(10 + int(given))
    for _ in range(60):
        limb, before, after = two_stances(graph, rng)
        wanted = some_branches(graph, rng, given)
        stances, step, able = asked(graph, limb, before, after, wanted, given)
        assert (stances.releases["branches"] == stances.branch_sets).all()
        plain = PlainChecks(graph, stances)
        of_step = PlainStep(plain, limb, 0, 1, step["pivot"], [*map(members, wanted)], given)
        edge = of_step.check()
        same_edge(step, edge, of_step.held)
        assert able == bool(edge.kept)


def test_pieces_of_a_swing_are_clear_where_every_motion_in_them_is(small):
    """A limb on a random line while the base goes along a part of a path and the others hold."""
    graph, rng, answers = small[0], np.random.default_rng(5), []
    for _ in range(60):
        limb, before, after = two_stances(graph, rng)
        stances, step, _ = asked(graph, limb, before, after, [ALL] * graph.limbs, False)
        plain = PlainChecks(graph, stances)
        of_step = PlainStep(plain, limb, 0, 1, step["pivot"], [members(ALL)] * graph.limbs, False)
        kind = int(rng.integers(2))
        path, standing = of_step.paths[kind], of_step.on_path[kind]
        if not all(standing.values()):
            continue
        start = plain.folds[int(rng.integers(len(plain.folds)))]
        end = start + rng.normal(size=6) * 0.3
        piece, holds = SwingCurve.rows(1), SupportRecord.rows(len(of_step.held))
        places = sorted(rng.uniform(0.0, 1.0, 2).tolist())
        piece["path"], piece["limb"] = path, limb
        piece["begin"], piece["finish"] = places
        piece["start"]["q"], piece["end"]["q"] = start, end
        corner = None
        if rng.integers(2):
            at = rng.uniform(*places)
            corner = np.array([at, *(start + rng.normal(size=6) * 0.3)])
            piece["rounded"], piece["turning"] = True, corner[0]
            piece["corner"]["q"] = corner[1:]
        chosen = {i: int(rng.choice([b for b, _ in standing[i]])) for i in of_step.held}
        for row, i in zip(holds, of_step.held, strict=True):
            row["limb"], row["point"], row["branch"] = i, after[i], chosen[i]
        world = graph.checks.world(None)
        ours = curve_clear(piece, holds, graph.checks.robots, world, SweepScratch.rows(1))
        swing = swinging(limb, start, end)
        motion = {"places": places, "corner": corner}
        truth = plain.clear(path, swing, swing, ("boxes", "body"), **motion) and all(
            plain.clear(path, of_step.holds(i, b), swing, ("boxes", "body", "meeting"), **motion)
            for i, b in chosen.items()
        )
        assert ours == truth
        answers.append(ours)
    assert 5 < sum(answers) < len(answers) - 5
