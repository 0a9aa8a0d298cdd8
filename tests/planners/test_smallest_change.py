"""The smallest changes of several kinds: each lets a plan through, and no smaller one does."""

import itertools
import json

import pytest
from map_data import BRIDGE

from mlivr_gym import Box, GraspMap, Settings, stance_graph
from mlivr_gym.cli.arguments import numbered_boxes
from mlivr_gym.cli.main import main
from mlivr_gym.planners import Planner
from mlivr_gym.planners.smallest_change import KINDS, smallest_changes

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


def test_the_command_says_what_would_help(bridge, tmp_path, capsys):
    world, boxes = tmp_path / "bridge.json", boxes_over_bridge()
    bridge.save(world)
    words = ["plan", "--map", str(world), "--no-manipulability", "--start", *START, "--goal"]
    words += [*map(str, GOAL), "--cost", "steps", "--suggest", "--occupied", "R2:0"]
    for box in boxes:
        words += ["--box", *map(str, box.bounds.ravel())]
    assert main([*words, "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    graph = stance_graph(bridge, settings=SETTINGS)
    graph.add_obstacles(numbered_boxes("box", [box.bounds.ravel().tolist() for box in boxes]))
    graph.occupy(["R2:0"])
    found = smallest_changes(graph, START, GOAL)
    assert [change["parts"] for change in told["suggestions"]] == [list(c.parts) for c in found]
    assert found
    assert all(change.message in told["error"] for change in found)
