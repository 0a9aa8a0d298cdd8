"""Tables of steps: with points taken away, and from the cache."""

from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym import Settings, robot_spec, stance_graph
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.stances.pair_build import fill_rows
from mlivr_gym.stances.pair_table_file import PAIR_TABLES
from mlivr_gym.stances.step_tables import step_tables, without_points


@pytest.fixture(autouse=True)
def cache(monkeypatch, tmp_path):
    """An empty cache folder."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))


def test_tables_without_some_points_are_those_of_the_occupied_map(small_map):
    graph = stance_graph(small_map, settings=Settings(collisions=False))
    free = step_tables(graph)
    taken = np.random.default_rng(0).permutation(len(small_map))[:10]
    occupied = np.zeros(len(small_map), dtype=bool)
    occupied[taken] = True
    thinned = without_points(free, occupied)
    graph.occupy(taken.tolist())
    there = step_tables(graph)
    for name in ("start", "after", "kept", "masks"):
        np.testing.assert_array_equal(getattr(thinned, name), getattr(there, name))


def assert_same(first, second):
    """What is known of the steps, of what can be released and of where limbs may hold."""
    for ours, others in (
        (first.steps.edges, second.steps.edges),
        (first.steps.released, second.steps.released),
    ):
        assert ours.dtype == others.dtype
        for name in ours.dtype.names:
            np.testing.assert_array_equal(ours[name], others[name])
    assert first.steps.edges["known"].any()
    assert first.steps.released["known"].any()
    np.testing.assert_array_equal(first.mask, second.mask)


def test_what_is_cached_is_what_was_worked_out(small_map, monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "new"))
    fewer = small_map.subset(small_map.positions[:, 0] < 2.2, "smaller")
    first = stance_graph(fewer)
    assert len(step_tables(first).after) > 200
    assert PAIR_TABLES.cached(first).exists()
    second = stance_graph(fewer)
    monkeypatch.setattr(
        "mlivr_gym.stances.pair_build.fill_rows", lambda *_: pytest.fail("the cache was not used")
    )
    step_tables(second)
    assert_same(first, second)
    monkeypatch.setattr("mlivr_gym.stances.pair_build.fill_rows", fill_rows)
    PAIR_TABLES.cached(first).write_bytes(b"no archive")
    third = stance_graph(fewer)
    step_tables(third)
    assert_same(first, third)
    other = stance_graph(fewer, settings=Settings(path_floor=0.035))
    assert PAIR_TABLES.cached(other) != PAIR_TABLES.cached(first)
    monkeypatch.setenv(CACHE_VARIABLE, "")
    assert PAIR_TABLES.cached(first) is None


def test_the_cache_tells_robots_maps_and_settings_apart(small_map, monkeypatch, tmp_path):
    """Whatever decides on a step is in the name of the file."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    fewer = small_map.subset(small_map.positions[:, 0] < 2.2, "smaller")
    robot, checked = robot_spec("mlivr2"), Settings(collisions=False)
    graphs = [
        stance_graph(fewer, robot, checked),
        stance_graph(fewer, replace(robot, characteristic_length=0.9), checked),
        stance_graph(fewer, replace(robot, body_mass=2.0 * robot.body_mass), checked),
        stance_graph(fewer, replace(robot, span=0.9 * robot.span), checked),
        stance_graph(fewer.subset(np.arange(len(fewer)) > 0, "smaller"), robot, checked),
        stance_graph(fewer, robot),
        stance_graph(fewer, robot, Settings(clearance=0.015)),
        stance_graph(fewer, robot, Settings(limb_threshold=0.11, collisions=False)),
        stance_graph(fewer, robot, Settings(manipulability=False, collisions=False)),
    ]
    assert len({PAIR_TABLES.cached(graph) for graph in graphs}) == len(graphs)
    assert PAIR_TABLES.cached(graphs[0]) == PAIR_TABLES.cached(
        stance_graph(fewer, "mlivr2", checked)
    )
