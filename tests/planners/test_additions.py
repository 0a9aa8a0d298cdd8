"""What would help: each candidate is put into a map of its own, on which a new graph plans."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from map_data import BRIDGE

from mlivr_gym import GraspMap, Settings, jem_map, stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.errors import MapError, SettingError
from mlivr_gym.planners import Planner
from mlivr_gym.planners.additions import one_more_limb, places_on_rails, points_to_add
from mlivr_gym.planners.smallest_change import smallest_changes

FREE = Settings(manipulability=False)
START, GOAL = ("R0:0", "R1:0"), (4.2, 0.0, 0.65)


def with_points(here, places, ids):
    """The map that has some of the candidates."""
    keep = np.isin(places.ids, ids)
    some = places.subset(keep) if keep.any() else None
    if some is None:
        return here
    return replace(
        here,
        ids=here.ids + some.ids,
        positions=np.concatenate([here.positions, some.positions]),
        rotations=np.concatenate([here.rotations, some.rotations]),
        faces=here.faces + some.faces,
    )


def plans(here, places, ids, start=START, goal=GOAL, settings=FREE):
    graph = stance_graph(with_points(here, places, ids), settings=settings)
    return bool(Planner(graph).plan(start, goal, "steps"))


@pytest.fixture(scope="module")
def broken():
    """The map of two platforms without the point between them, whose rail stays."""
    whole = GraspMap.from_dict(BRIDGE)
    return whole.subset(np.array(whole.ids) != "R2:0")


def test_the_points_that_help_alone_are_all_of_them(broken):
    found = points_to_add(stance_graph(broken, settings=FREE), START, GOAL)
    places = places_on_rails(broken)
    assert found.candidates.ids == places.ids
    assert found.alone == tuple(p for p in places.ids if plans(broken, places, [p]))
    assert "R2:+0" in found.alone
    assert found.points == found.alone[:1]
    assert found.is_smallest
    assert "R2:+0" in found.message


def test_points_that_help_only_together_are_found(broken):
    """The second platform is 2 m farther away, so that two points are needed in between."""
    data = copy.deepcopy(BRIDGE)
    for rail in data["segments"][3:]:
        rail["start"][0] += 2.0
        rail["end"][0] += 2.0
    whole = GraspMap.from_dict(data)
    here = whole.subset(np.array(whole.ids) != "R2:0")
    row = {"face": "floor", "normal": [0, 0, 1], "rail": [0, 1, 0]}
    points = [{"id": f"P{k}", "position": [k, 0, 0], **row} for k in (1, 2, 3, 4, 5)]
    places = GraspMap.from_dict({"points": points})
    goal = (6.2, 0.0, 0.65)
    found = points_to_add(stance_graph(here, settings=FREE), START, goal, places)
    assert found.alone == ()
    assert not any(plans(here, places, [p], goal=goal) for p in places.ids)
    assert plans(here, places, found.points, goal=goal)
    assert len(found.points) == 2
    assert found.is_smallest
    for spared in found.points:
        rest = [p for p in found.points if p != spared]
        assert not plans(here, places, rest, goal=goal)
    beyond = points_to_add(
        stance_graph(here, settings=FREE), START, goal, places.subset(np.arange(5) < 1)
    )
    assert beyond.points == ()
    assert "not even all together" in beyond.message


def test_places_lie_on_rails_clear_of_points_and_handrails(jem):
    places = places_on_rails(jem)
    gaps = np.linalg.norm(places.positions[:, None] - jem.positions, axis=2).min(axis=1)
    assert gaps.min() > 0.09
    rails = {segment.id: segment for segment in jem.segments}
    for name, at in zip(places.ids, places.positions, strict=True):
        rail, away = name.rsplit(":", 1)
        ends = np.array([rails[rail].start, rails[rail].end])
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        np.testing.assert_allclose(ends.mean(axis=0) + 1e-3 * int(away) * along, at, atol=1e-9)
    # With the points they are those of the map whose points are laid out at that spacing.
    assert len(places) + len(jem) == len(jem_map(spacing=0.1))


def test_a_limb_more_is_tried_from_a_start_that_it_holds(ladder):
    graph = stance_graph(ladder, settings=Settings(collisions=False, manipulability=False))
    start, goal = graph.ids(graph.points[0]), graph.base_position[-1]
    found = one_more_limb(graph, start, goal, limit=50)
    other = stance_graph(ladder, "mlivr3", graph.settings)
    assert found.robot == "mlivr3"
    assert found.start[:2] == start
    result = Planner(other).plan(found.start, goal, "steps", limit=50)
    assert bool(result) == found.has_plan
    assert found.robot in found.message
    alone = replace(graph.robot, name="mine", tool_length=graph.robot.tool_length + 0.01)
    assert one_more_limb(stance_graph(ladder, alone, graph.settings), start, goal) is None


def test_faulty_arguments_are_refused(broken, ladder):
    three = stance_graph(ladder, "mlivr3", Settings(collisions=False))
    with pytest.raises(SettingError, match="need two limbs"):
        points_to_add(three, (0, 1, 2), (0.0, 0.0, 0.6))
    bare = replace(broken, segments=())
    with pytest.raises(MapError, match="give candidates"):
        points_to_add(stance_graph(bare, settings=FREE), START, GOAL)


def test_the_command_says_what_would_help(broken, tmp_path, capsys):
    world = tmp_path / "broken.json"
    broken.save(world)
    words = ["plan", "--map", str(world), "--no-manipulability", "--start", *START, "--goal"]
    words += [*map(str, GOAL), "--cost", "steps", "--suggest"]
    assert main([*words, "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    found = smallest_changes(stance_graph(broken, settings=FREE), START, GOAL)
    assert [change["parts"] for change in told["suggestions"]] == [list(c.parts) for c in found]
    assert all(change.message in told["error"] for change in found)
