"""Reach of a start: NetworkX on all states, none of them left out."""

import json

import networkx as nx
import numpy as np
import pytest
from map_data import BRIDGE
from state_graph import reachable

from mlivr_gym import Box, GraspMap, Settings, stance_graph
from mlivr_gym.cli.main import main
from mlivr_gym.errors import SettingError, UnknownPointError
from mlivr_gym.planners.reach import NOT_REACHED, reach_from
from mlivr_gym.stances.random_states import random_state


def truth(graph, start, known=None):
    """Fewest steps to each point, by the distances of all states that can be reached."""
    fewest = np.full(len(graph.grasp_map), NOT_REACHED)
    distances = nx.single_source_shortest_path_length(reachable(graph, start, known=known), start)
    for state, distance in sorted(distances.items(), key=lambda one: -one[1]):
        fewest[[*state.stance]] = distance
    return fewest


@pytest.fixture(scope="module")
def few(jem):
    keep = (jem.positions[:, 0] < 3.6) & (np.random.default_rng(3).random(len(jem)) < 0.25)
    return stance_graph(jem.subset(keep, "few"))


def test_the_steps_are_the_fewest_of_all_states(few):
    net = nx.DiGraph()
    for seed in range(3):
        start = random_state(few, np.random.default_rng(seed))
        reach = reach_from(few, start)
        assert reach.is_complete
        np.testing.assert_array_equal(reach.steps, truth(few, start, net))


def test_an_obstacle_keeps_points_out_of_reach(few):
    first = few.points[int(np.argmin(few.base_position[:, 0]))].tolist()
    without = reach_from(few, first).steps
    x = few.grasp_map.positions[:, 0].max() - 0.4
    few.add_obstacles([Box.between("wall", "obstacle", (x, -3.0, -3.0), (x + 0.1, 3.0, 3.0))])
    try:
        start = few.state(first)
        reach = reach_from(few, start)
        np.testing.assert_array_equal(reach.steps, truth(few, start))
        assert reach.is_complete
        assert (reach.steps == NOT_REACHED).sum() > (without == NOT_REACHED).sum()
    finally:
        few.remove_obstacles()


def test_a_search_that_ends_early_proves_nothing(few):
    start = random_state(few, np.random.default_rng(0))
    all_steps = reach_from(few, start).steps
    assert all_steps.max() > 1
    one = reach_from(few, start, most_steps=1)
    assert not one.is_complete
    np.testing.assert_array_equal(one.steps, np.where(all_steps <= 1, all_steps, NOT_REACHED))
    assert not reach_from(few, start, limit=1).is_complete


def test_three_limbs_reach_the_points_of_their_successors(ladder):
    graph = stance_graph(ladder, "mlivr3", Settings(collisions=False, manipulability=False))
    start = random_state(graph, np.random.default_rng(0))
    reach = reach_from(graph, start, most_steps=1)
    grasped = set(graph.successors(start).point.tolist())
    assert set(np.flatnonzero(reach.steps == 1)) == grasped.difference(start.stance)


def test_faulty_arguments_are_refused(few):
    with pytest.raises(UnknownPointError):
        reach_from(few, ("nowhere", "D1a:0"))
    with pytest.raises(SettingError):
        reach_from(few, (0, 1), most_steps=-1)


def test_the_command_tells_and_draws_the_reach(tmp_path, capsys):
    world, picture = tmp_path / "bridge.json", tmp_path / "reach.png"
    world.write_text(json.dumps(BRIDGE))
    words = ["reach", "--map", str(world), "--no-manipulability", "--start", "R0:0", "R1:0"]
    assert main([*words, "--picture", str(picture), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    graph = stance_graph(GraspMap.from_dict(BRIDGE), settings=Settings(manipulability=False))
    reach = reach_from(graph, ("R0:0", "R1:0"))
    assert list(told["steps"].values()) == reach.steps.tolist()
    assert told["is_complete"]
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("  0: 2 points, R0:0 R1:0")
