"""The complete tables that ship against what is worked out without them."""

from pathlib import Path

import numpy as np
import pytest

from mlivr_gym import Settings, stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.paper import case_graph, default_setup
from mlivr_gym.postures.postures import FIELDS
from mlivr_gym.stances.table_build import fill_rows
from mlivr_gym.stances.table_files import TableFiles
from mlivr_gym.stances.two_limb_table_file import TWO_LIMB_TABLES

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
    kept, worked_out = graph.file_contents(), fresh.file_contents()
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
    for held in range(2):
        for s in chosen:
            row = fresh.row(held, s)
            fresh.check_steps(np.full(len(row), held), np.full(len(row), s), row)
            for before, after in ((s, row), (row, s)):
                which = fresh._free.index(held, before, after)
                np.testing.assert_array_equal(graph.steps.edges[which], fresh.steps.edges[which])
    fresh.check_releases(np.array([(s, limb) for s in chosen for limb in range(2)]))
    for name in fresh.steps.releases.dtype.names:
        ours, theirs = (one.steps.releases[name][chosen] for one in (graph, fresh))
        np.testing.assert_array_equal(ours, theirs, err_msg=name)


def test_a_table_ships_for_each_of_these_worlds_and_no_other():
    names = set()
    for world in WORLDS.values():
        graph = world()
        names.add(TWO_LIMB_TABLES.name(graph))
        assert graph.is_complete
    assert {path.name for path in Path(asset_path("")).glob("pairs-*")} == names


def test_the_default_world_worked_out_afresh_is_that_which_ships(without_tables):
    graph, fresh = stance_graph(), without_tables(stance_graph)
    assert_same_stances(graph, fresh)
    chosen = np.random.default_rng(11).choice(len(graph), STANCES, replace=False)
    assert_same_steps(graph, fresh, chosen)


def test_other_settings_are_worked_out():
    graph = stance_graph(settings=Settings(clearance=0.021, limb_threshold=0.12))
    assert not asset_path(TWO_LIMB_TABLES.name(graph)).exists()
    assert not graph.is_complete


@pytest.mark.slow
@pytest.mark.parametrize("world", WORLDS.values(), ids=WORLDS)
def test_whole_tables_worked_out_afresh_are_those_that_ship(without_tables, world):
    graph, fresh = world(), without_tables(world)
    fill_rows(fresh)
    assert_same_stances(graph, fresh)
    ours, theirs = graph.file_contents(), fresh.file_contents()
    np.testing.assert_array_equal(ours.edges, theirs.edges)
    np.testing.assert_array_equal(ours.releases, theirs.releases)
