"""Roadmaps of many limbs against the stance graph that they are a part of."""

import itertools
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from mlivr_gym import stance_graph
from mlivr_gym.errors import MlivrError
from mlivr_gym.planners import Planner
from mlivr_gym.planners.first_walk import FACTORS, LEAST_COST, Joining
from mlivr_gym.planners.label_search import Origins, cheapest_walk
from mlivr_gym.planners.query import Goal
from mlivr_gym.planners.roadmap import Roadmap, RoadmapError, codes, one_limb_apart, roadmap_files
from mlivr_gym.planners.roadmap_build import build
from mlivr_gym.planners.step_odds import features, fitted
from mlivr_gym.transitions.state import State


@pytest.fixture(scope="module")
def graph(jem):
    """Four limbs on part of the JEM."""
    part = jem.subset(jem.positions[:, 0] < 2.6, "part")
    return stance_graph(part, "mlivr4")


@pytest.fixture(scope="module")
def roadmap(graph):
    return build(graph, 40)


def test_pairs_one_limb_apart_are_all_there_are():
    rng = np.random.default_rng(0)
    points = np.array(list(itertools.permutations(range(7), 4)))
    points = points[points.argmin(axis=1) == 0]
    points = points[np.sort(rng.choice(len(points), 90, replace=False))]
    points = points[np.argsort(codes(points))]
    pairs, expected = one_limb_apart(points), set()
    for a, b in itertools.combinations(range(len(points)), 2):
        for turn in range(4):
            there = np.roll(points[b], turn)
            if (points[a] != there).sum() == 1:
                expected.add((a, b, *there.tolist()))
    found = {
        (*rows, *after)
        for rows, after in zip(
            pairs.rows.tolist(), pairs.stances_after(points).tolist(), strict=True
        )
    }
    assert found == expected
    assert len(found) == len(pairs.rows) > 100
    here, there = points[pairs.rows[:, 0]], pairs.stances_after(points)
    np.testing.assert_array_equal((here != there).argmax(axis=1), pairs.limbs[:, 0])


def test_roads_are_the_steps_of_the_graph_between_its_stances(graph, roadmap):
    """All of them and no others, from all branches, with the masks that the graph says."""
    roads, rng = roadmap.roads, np.random.default_rng(1)
    for s in rng.choice(len(roadmap), 12, replace=False).tolist():
        state = graph.state(tuple(roadmap.points[s].tolist()))
        steps, found = graph.successors(state), {}
        for k in range(len(steps.limb)):
            after = steps.after(state, k)
            row = int(roadmap.find(np.array([after.stance]))[0])
            if row >= 0:
                found[row] = after
        mine = range(roads.start[s], roads.start[s + 1])
        assert {int(roads.other[e]) for e in mine} == set(found)
        for e in mine:
            after = found[int(roads.other[e])]
            limb, masks = int(roads.limb[e]), list(state.masks)
            kept = [int(roads.kept[e, i]) & (masks[i] if i != limb else -1) for i in range(4)]
            assert tuple(kept) == after.masks
            there = np.roll(after.stance, -int(roads.turn[e]))
            np.testing.assert_array_equal(there, roadmap.points[roads.other[e]])


def test_a_roadmap_is_read_as_it_was_written(graph, roadmap, tmp_path):
    path = tmp_path / "roadmap.npz"
    roadmap.write(path)
    again = Roadmap.read(path)
    assert again.key == roadmap.key
    for name in ("points", "released", "kept", "odds"):
        np.testing.assert_array_equal(getattr(again, name), getattr(roadmap, name))
    for one, other in zip(again.pairs, roadmap.pairs, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(again.base_position, roadmap.base_position, atol=1e-6)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"{}"])
def test_what_is_no_roadmap_is_refused(tmp_path, content):
    path = tmp_path / "roadmap.npz"
    path.write_bytes(content)
    with pytest.raises(RoadmapError, match="no roadmap of format"):
        Roadmap.read(path)


def test_the_same_expansions_give_the_same_roadmap(graph, roadmap):
    again = build(graph, 40)
    np.testing.assert_array_equal(again.points, roadmap.points)
    np.testing.assert_array_equal(again.kept, roadmap.kept)


def test_no_more_stances_are_kept_than_are_asked_for(graph, roadmap):
    """Those that are kept and their steps are as without."""
    fewer = build(graph, 40, most=150)
    assert len(fewer) == 150 < len(roadmap)
    rows = roadmap.find(fewer.points)
    assert (rows >= 0).all()
    np.testing.assert_array_equal(fewer.released, roadmap.released[rows])
    theirs = {tuple(p): k for p, k in zip(roadmap.pairs.rows.tolist(), roadmap.kept, strict=True)}
    assert len(fewer.pairs.rows) > 150
    for pair, kept in zip(rows[fewer.pairs.rows].tolist(), fewer.kept, strict=True):
        np.testing.assert_array_equal(kept, theirs[tuple(pair)])


def test_no_roadmap_is_built_where_none_is_meant(graph, small_graph):
    with pytest.raises(RoadmapError, match="at most 4 limbs"):
        build(stance_graph(graph.grasp_map, replace(graph.robot, limbs=5)), 10)
    graph.occupy([0])
    try:
        with pytest.raises(RoadmapError, match="without obstacles"):
            build(graph, 10)
    finally:
        graph.vacate()


def ends(roadmap):
    """A stance, and a base position at the other end of what is joined with it."""
    roads, count = roadmap.roads, len(roadmap)
    joined = csr_array((np.ones(len(roads.other)), roads.other, roads.start), shape=(count, count))
    _, part = connected_components(joined)
    largest = np.flatnonzero(part == np.bincount(part).argmax())
    x = roadmap.base_position[largest, 0]
    first, last = largest[x.argmin()], largest[x.argmax()]
    return tuple(roadmap.points[first].tolist()), roadmap.base_position[last]


def first_walk(graph, roadmap, start, goal, cost="steps", seconds=4.0):
    target = Goal.checked(graph, np.clip(goal, *graph.grasp_map.cabin), cost, None, 0.2)
    return Joining(graph, roadmap, target, time.perf_counter() + seconds, 2000).walk(start)


def test_a_first_walk_leads_over_steps_of_the_graph_to_the_goal(graph, roadmap):
    """Also from a stance that is not on the roadmap, and with points newly occupied."""
    origin, goal = ends(roadmap)
    state = graph.state(origin)
    beside = graph.successors(state)
    starts = [state, *(beside.after(state, k) for k in range(3))]
    asked = [(state, "base"), *((s, "steps") for s in starts)]
    walks = [first_walk(graph, roadmap, s, goal, c) for s, c in asked]
    assert sum(map(bool, walks)) > 2
    for walk in filter(None, walks):
        for (state, _), (after, _) in itertools.pairwise(walk):
            steps = graph.successors(state)
            assert after in [steps.after(state, k) for k in range(len(steps.limb))]
        assert np.linalg.norm(walk[-1][1].base_position[0] - goal) <= 0.2
    longest = max(filter(None, walks), key=len)
    taken = {p for state, _ in longest for p in state.stance}
    here = {*longest[0][0].stance, *longest[-1][0].stance}
    busy = sorted(taken - here)[:2]
    graph.occupy(busy)
    try:
        walk = first_walk(graph, roadmap, longest[0][0], goal)
        for state, _ in walk or []:
            assert not set(busy) & set(state.stance)
    finally:
        graph.vacate()


def test_from_a_stance_of_the_roadmap_the_walk_is_the_one_over_it(graph, roadmap):
    """Of the robot as it has turned: no step that the roadmap tells has to be taken out."""
    roads, count = roadmap.roads, len(roadmap)
    cost = np.full(len(roads.other), 1.0 + LEAST_COST)
    matrix, long = csr_array((cost, roads.other, roads.start), shape=(count, count)), 0
    for goal in roadmap.base_position[:: count // 12]:
        target = np.clip(goal, *graph.grasp_map.cabin)
        reached = np.linalg.norm(roadmap.base_position - target, axis=1) <= 0.2
        h = dijkstra(matrix, indices=np.flatnonzero(reached), min_only=True)
        row = int(np.where(np.isfinite(h), h, -1.0).argmax())
        start = graph.state(tuple(np.roll(roadmap.points[row], 1).tolist()))
        masks = np.roll(start.masks, -1)[None]
        origins = Origins(np.array([row]), masks, np.zeros(1))
        expected = cheapest_walk(roads, cost, h, origins, FACTORS)
        if expected is not None:
            walk = first_walk(graph, roadmap, start, goal)
            there = np.array([state.stance for state, _ in walk])
            np.testing.assert_array_equal(roadmap.find(there), expected.stances)
            long += len(walk) > 4
    assert long > 2


def test_no_walk_rests_on_a_roadmap_that_is_wrong(graph, roadmap):
    """All stances one limb apart are said to be joined, on all branches; few are."""
    pairs = one_limb_apart(roadmap.points)
    assert len(pairs.rows) > len(roadmap.pairs.rows)
    wrong = replace(roadmap, pairs=pairs, kept=np.full((len(pairs.rows), 4), 0xFFFF))
    origin, goal = ends(roadmap)
    walk = first_walk(graph, wrong, graph.state(origin), goal, seconds=2.0)
    for (state, _), (after, _) in itertools.pairwise(walk or []):
        steps = graph.successors(state)
        assert after in [steps.after(state, k) for k in range(len(steps.limb))]


def test_a_walk_ends_at_the_goal_where_the_last_base_is_elsewhere_now(graph, roadmap):
    """The roadmap puts some bases into the goal region that are not there."""
    origin, goal = ends(roadmap)
    away = np.linalg.norm(roadmap.base_position - goal, axis=1)
    target = np.clip(goal, *graph.grasp_map.cabin)
    base = np.where(away[:, None] < 0.4, target, roadmap.base_position)
    wrong = replace(roadmap, base_position=base)
    walk = first_walk(graph, wrong, graph.state(origin), goal)
    if walk is not None:
        assert np.linalg.norm(walk[-1][1].base_position[0] - target) <= 0.2


def test_odds_tell_steps_from_others(graph):
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(4000, 4))
    rows[:, 0] = 1.0
    truth = np.array([-1.0, 2.0, -0.5, 0.0])
    steps = rng.random(len(rows)) < 1.0 / (1.0 + np.exp(-rows @ truth))
    np.testing.assert_allclose(fitted(rows, steps), truth, atol=0.2)


@pytest.mark.parametrize("robot", ["mlivr3", "mlivr4"])
def test_steps_of_the_roadmaps_that_ship_are_steps(robot):
    """From random stances of them all branches keep what the file says."""
    graph = stance_graph(robot=robot)
    roadmap, rng = Roadmap.of(graph), np.random.default_rng(4)
    assert roadmap is not None
    assert len(roadmap) > 10_000
    picked = rng.choice(len(roadmap.pairs.rows), 60, replace=False)
    pairs = roadmap.pairs.take(picked)
    before, after = roadmap.points[pairs.rows[:, 0]], pairs.stances_after(roadmap.points)
    here, there = graph.nodes(before), graph.nodes(after)
    assert graph.is_node(here).all()
    assert graph.is_node(there).all()
    states = [
        State(tuple(s), tuple(m)) for s, m in zip(before.tolist(), here.mask.tolist(), strict=True)
    ]
    masks = graph.masks_after(states, here, np.arange(len(picked)), after, there)
    limb = (before != after).argmax(axis=1)
    masks[np.arange(len(picked)), limb] = 0
    np.testing.assert_array_equal(masks, roadmap.kept[picked])
    np.testing.assert_allclose(
        roadmap.base_position[pairs.rows[:, 0]], here.base_position, atol=1e-5
    )
    assert features(graph, states[0].stance, here.take(np.array([0])), after[:1]).shape == (1, 4)


def test_plans_of_four_limbs_come_from_the_roadmap(jem):
    """Ends of the module apart, and each step moves one limb."""
    graph = stance_graph(jem, "mlivr4")
    start, goal = ends(Roadmap.of(graph))
    plan = Planner(graph).plan(start, goal, "steps").unwrap()
    assert plan.statistics.bound >= 1.0
    assert plan.base_translation > 5.0
    assert np.linalg.norm(plan.configuration(len(plan.steps))[0] - goal) <= 0.2


def test_a_kept_roadmap_that_cannot_be_read_is_passed_over(jem, tmp_path, monkeypatch, caplog):
    graph = stance_graph(jem, "mlivr3")
    monkeypatch.setattr("mlivr_gym.planners.roadmap.cache_folder", lambda: tmp_path)
    roadmap_files(graph)[0].write_bytes(b"nothing")
    assert len(Roadmap.of(graph)) > 10_000
    assert "no roadmap of format" in caplog.text


def test_where_roadmaps_are_kept(graph, tmp_path, monkeypatch):
    monkeypatch.setenv("MLIVR_GYM_CACHE", str(tmp_path))
    assert roadmap_files(graph)[0].parent == tmp_path
    assert Roadmap.of(graph) is None
    assert issubclass(RoadmapError, MlivrError)
