"""The smallest changes of several kinds: each lets a plan through, and no smaller one does."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from map_data import BRIDGE
from unreachable import unreachable

from mlivr_gym import Box, GraspMap, Settings, stance_graph
from mlivr_gym.cli.arguments import numbered_boxes
from mlivr_gym.extensions.why_not import smallest_change
from mlivr_gym.extensions.why_not.smallest_change import (
    KINDS,
    THRESHOLD_RESOLUTION,
    Change,
    minimum_subset,
    smallest_changes,
    smallest_subset,
)
from mlivr_gym.planners import Planner

START, GOAL = ("R0:0", "R1:0"), (4.2, 0.0, 0.65)
SETTINGS = Settings(manipulability=False)


def boxes_over_bridge():
    """Boxes over the only point between two platforms, one on another, and one elsewhere."""
    lid = Box.between("lid", "obstacle", (1.6, -0.3, 0.05), (2.2, 0.3, 0.4))
    crate = Box.between("crate", "obstacle", (1.6, -0.3, 0.55), (2.2, 0.3, 1.1))
    far = Box.between("far", "obstacle", (30.0, 0.0, 0.0), (31.0, 1.0, 1.0))
    return [far, lid, crate]


@pytest.fixture(scope="module")
def bridge():
    return GraspMap.from_dict(BRIDGE)


def steps(world, settings=SETTINGS, boxes=(), occupied=()):
    """Steps of a plan on a graph of its own, None without one."""
    graph = stance_graph(world, settings=settings)
    graph.add_obstacles(boxes)
    graph.occupy(occupied)
    found = Planner(graph).plan(START, GOAL, "steps")
    return len(found.plan.steps) if found.plan is not None else None


def test_fewer_obstacles_open_the_way_and_less_does_not(bridge):
    """All sets of obstacles are tried."""
    graph, blocked = stance_graph(bridge, settings=SETTINGS), ["R2:0"]
    graph.add_obstacles(boxes_over_bridge())
    graph.occupy(blocked)
    assert not Planner(graph).plan(START, GOAL, "steps")
    found = {change.kind: change for change in smallest_changes(graph, START, GOAL)}
    sizes = [(change.size, KINDS.index(kind)) for kind, change in found.items()]
    assert sizes == sorted(sizes)

    def without(gone):
        kept = [box for box in boxes_over_bridge() if box.id not in gone]
        return steps(bridge, boxes=kept, occupied=[p for p in blocked if p not in gone])

    names = [*(box.id for box in graph.obstacles), *blocked]
    enough = next(
        size
        for size in range(len(names) + 1)
        if any(without(some) for some in itertools.combinations(names, size))
    )
    removed = found["obstacles"]
    assert removed.is_smallest
    assert removed.size == enough > 1
    assert "far" not in removed.parts
    assert without(removed.parts) == removed.steps is not None


def test_the_command_says_what_would_help(bridge, tmp_path, run):
    world, boxes = tmp_path / "bridge.json", boxes_over_bridge()
    bridge.save(world)
    words = ["suggest", "--map", str(world), "--no-manipulability", "--start", *START, "--goal"]
    words += [*map(str, GOAL), "--occupied", "R2:0"]
    for box in boxes:
        words += ["--box", *map(str, box.bounds.ravel())]
    told = json.loads(run(*words, "--json")[1])
    graph = stance_graph(bridge, settings=SETTINGS)
    graph.add_obstacles(numbered_boxes("box", [box.bounds.ravel().tolist() for box in boxes]))
    graph.occupy(["R2:0"])
    found = smallest_changes(graph, START, GOAL)
    assert found
    assert [change["parts"] for change in told["changes"]] == [list(c.parts) for c in found]
    bridge.subset([point != "R2:0" for point in bridge.ids], "gap").save(world)
    code, out, _ = run(*words[: words.index("--occupied")])
    assert (code, out.count("no change")) == (0, 1)


@given(st.lists(st.sets(st.integers(0, 8), min_size=1), min_size=1, max_size=6))
def test_a_minimum_subset_has_as_few_entries_as_any_that_suffices(enough):
    """Some entries suffice if they contain one of several sets.

    A subset of which none can be spared is found at once; it may be larger.
    """

    def suffices(some):
        return any(one <= set(some) for one in enough)

    entries = [*range(9)]
    found, is_proved = minimum_subset(entries, suffices)
    assert suffices(found)
    assert is_proved
    assert len(found) == min(map(len, enough))
    small = smallest_subset(entries, suffices)
    assert sorted(small) == small
    few, is_proved = minimum_subset(entries, suffices, most=0)
    assert is_proved == (not small)
    for some in (small, few):
        assert suffices(some)
        assert not any(suffices([one for one in some if one != spared]) for spared in some)


def test_with_the_lower_threshold_there_is_a_plan_and_one_unit_higher_there_is_none(jem):
    few = jem.subset(np.random.default_rng(0).random(len(jem)) < 0.35, "sparse")
    settings = Settings(limb_threshold=0.15, collisions=False)
    graph, rng = stance_graph(few, settings=settings), np.random.default_rng(0)
    changes = ()
    for _ in range(20):
        start, goal = unreachable(graph, rng)
        changes = smallest_changes(graph, start, goal, goal_tolerance=0.05)
        if changes:
            break
    (change,) = changes
    assert change.kind == "limb_threshold"
    highest = float(change.parts[0])
    for value in (highest, round(highest + THRESHOLD_RESOLUTION, 9)):
        other = stance_graph(few, settings=replace(settings, limb_threshold=value))
        found = Planner(other).plan(start.stance, goal, "steps", goal_tolerance=0.05)
        assert bool(found) == (value == highest)
        assert not found or len(found.plan.steps) == change.steps


@pytest.mark.parametrize("count", [1, 2])
def test_the_change_of_fewest_parts_comes_first(small_checked_graph, monkeypatch, count):
    """Of two of equal size that of obstacles."""
    graph, parts = small_checked_graph, ("a", "b")[:count]
    given = {
        "_fewer_obstacles": Change("obstacles", parts, True, 3),
        "_lower_threshold": Change("limb_threshold", ("0.05",), True, 3),
    }
    for name, change in given.items():
        monkeypatch.setattr(smallest_change, name, lambda *_, change=change: [change])
    found = smallest_changes(graph, graph.points[0].tolist(), graph.base_position[-1])
    assert found == tuple(given.values())[:: 1 if count == 1 else -1]
