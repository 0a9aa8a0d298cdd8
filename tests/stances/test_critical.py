"""Points and rails whose loss cuts stances off, against NetworkX with each of them removed."""

import networkx as nx
import numpy as np
import pytest
from map_data import BRIDGE

from mlivr_gym import GraspMap, Settings, stance_graph
from mlivr_gym.stances.critical import point_losses, rail_losses
from mlivr_gym.stances.table_build import fill_rows
from mlivr_gym.transitions.state import State


def truth(graph, lost):
    """Stances that hold a point of `lost`, and those cut off, by successors of all stances."""
    net = nx.Graph()
    able = (graph.branch_sets > 0).all(axis=1)
    for points, branch_sets in zip(
        graph.points[able].tolist(), graph.branch_sets[able].tolist(), strict=True
    ):
        state = State(tuple(points), tuple(branch_sets))
        net.add_node(state.stance)
        steps = graph.successors(state)
        for k in range(len(steps.limb)):
            net.add_edge(state.stance, steps.after(state, k).stance)
    held = [stance for stance in net if lost.intersection(stance)]
    cut_off = 0
    for part in nx.connected_components(net):
        rest = nx.connected_components(net.subgraph(part - set(held)))
        sizes = [len(one) for one in rest]
        cut_off += sum(sizes) - max(sizes, default=0)
    return len(held), cut_off


@pytest.fixture(scope="module")
def checked(jem):
    """A few points of the module, every step checked."""
    keep = (jem.positions[:, 0] < 3.6) & (np.random.default_rng(3).random(len(jem)) < 0.25)
    graph = stance_graph(jem.subset(keep, "few"))
    fill_rows(graph)
    return graph


def test_losses_of_checked_steps_are_those_of_networkx(checked):
    losses = point_losses(checked)
    assert len(losses) == len(checked.grasp_map)
    for loss in losses:
        assert loss[2:] == truth(checked, {checked.grasp_map.index(loss.id)})
    rails = rail_losses(checked)
    assert sorted(p for loss in rails for p in loss.points) == sorted(checked.grasp_map.ids)
    for loss in rails:
        assert loss[2:] == truth(checked, {checked.grasp_map.index(p) for p in loss.points})
    for found in (losses, rails):
        assert any(loss.is_critical for loss in found)
        order = [(-loss.cut_off, -loss.stances) for loss in found]
        assert order == sorted(order)


def test_the_only_point_between_two_platforms_is_critical_and_obstacles_count():
    graph = stance_graph(
        GraspMap.from_dict(BRIDGE), settings=Settings(transitions=False, manipulability=False)
    )
    worst = point_losses(graph)[0]
    assert (worst.id, worst[2:]) == ("R2:0", truth(graph, {graph.grasp_map.index("R2:0")}))
    assert worst.is_critical
    assert rail_losses(graph)[0].id == "R2"
    graph.occupy(["R2:0"])
    for loss in point_losses(graph):
        assert loss[2:] == truth(graph, {graph.grasp_map.index(loss.id)})
    assert not next(loss for loss in point_losses(graph) if loss.id == "R2:0").is_critical
