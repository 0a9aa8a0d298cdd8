"""The complete tables that ship against what is worked out without them."""

from pathlib import Path

import numpy as np
import pytest

from mlivr_gym import Settings, stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.paper import case_graph, default_setup
from mlivr_gym.postures.postures import FIELDS
from mlivr_gym.stances.node_table_build import build
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.stances.table_files import TableFiles

WORLDS = {
    "default": stance_graph,
    "without collisions": lambda: stance_graph(settings=Settings(collisions=False)),
    "case 1, steps": lambda: case_graph(1, default_setup(), "steps"),
}
STANCES = 20


@pytest.fixture
def without_tables(monkeypatch):
    """Makes a graph as if no table shipped."""

    def make(world):
        with monkeypatch.context() as patched:
            patched.setattr(TableFiles, "find", lambda *_: None)
            graph = world()
        assert not graph.is_complete
        return graph

    return make


def assert_same_stances(graph, fresh):
    np.testing.assert_array_equal(graph.points, fresh.points)
    kept, worked_out = graph.listed, fresh.listed
    assert dict(kept.counts) == dict(worked_out.counts)
    for name in FIELDS:
        assert_same(*(getattr(one.postures, name) for one in (kept, worked_out)), name)


def assert_same(ours, theirs, name):
    """To the last bit; manipulability to 1e-12, since the order of its sums may change."""
    if name in ("w_m", "w_b"):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, err_msg=name)
    else:
        np.testing.assert_array_equal(ours, theirs, err_msg=name)


def assert_same_steps(graph, fresh, chosen):
    """All steps of some stances, there and back, and what can be released there."""
    for s in chosen:
        state = graph.state(graph.points[s].tolist())
        for one, other in zip(graph.successors(state), fresh.successors(state), strict=True):
            np.testing.assert_array_equal(one, other)
    theirs = fresh.all_releases(fresh.points[chosen], fresh.node_postures(chosen))
    for name in theirs.dtype.names:
        np.testing.assert_array_equal(graph.listed.releases[name][chosen], theirs[name])


def test_a_table_ships_for_each_of_these_worlds_and_no_other():
    names = {TABLES.name(stance_graph(robot=f"mlivr{limbs}")) for limbs in (3, 4)}
    for world in WORLDS.values():
        graph = world()
        names.add(TABLES.name(graph))
        assert graph.is_complete
    assert {path.name for path in Path(asset_path("")).glob("table-*")} == names


def test_the_default_world_worked_out_afresh_is_that_which_ships(without_tables):
    graph, fresh = stance_graph(), without_tables(stance_graph)
    assert_same_stances(graph, fresh)
    chosen = np.random.default_rng(11).choice(len(graph), STANCES, replace=False)
    assert_same_steps(graph, fresh, chosen)


@pytest.mark.slow
@pytest.mark.parametrize("world", WORLDS.values(), ids=WORLDS)
def test_whole_tables_worked_out_afresh_are_those_that_ship(without_tables, world):
    graph, fresh = world(), without_tables(world)
    fresh.graph_table = build(fresh)
    assert_same_stances(graph, fresh)
    for one, other in zip(graph.table, fresh.table, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(graph.listed.releases, fresh.listed.releases)
