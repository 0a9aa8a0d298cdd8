"""Tables of steps: with points taken away, and the names of their files."""

from dataclasses import replace

import numpy as np
import pytest
from small_tables import small_table

from mlivr_gym import Settings, robot_spec, stance_graph
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.stances.step_tables import step_tables, without_points
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.stances.table_files import TableError


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
    other = stance_graph(small_map, settings=Settings(collisions=False))
    for one in (graph, other):  # the second has no steps on all points
        one.occupy(taken.tolist())
    for name, there in step_tables(other)._asdict().items():
        np.testing.assert_array_equal(getattr(thinned, name), there)
        np.testing.assert_array_equal(getattr(step_tables(graph), name), there)
    graph.vacate()
    for name, there in free._asdict().items():
        np.testing.assert_array_equal(getattr(step_tables(graph), name), there)


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
        stance_graph(fewer, robot, Settings(path_floor=0.035)),
        stance_graph(fewer, robot, Settings(limb_threshold=0.11, collisions=False)),
        stance_graph(fewer, robot, Settings(manipulability=False, collisions=False)),
    ]
    assert len({TABLES.cached(graph) for graph in graphs}) == len(graphs)
    assert TABLES.cached(graphs[0]) == TABLES.cached(stance_graph(fewer, "mlivr2", checked))


def test_a_table_with_a_number_just_outside_its_range_is_refused(tmp_path):
    """Compiled code uses these numbers as indices, and checksums are those of what was written."""
    graph, _ = small_table(2)
    path, arrays = tmp_path / "table.npz", TABLES.encode(graph, graph.graph_table)

    def is_refused(**changed):
        path.write_bytes(TABLES.pack(graph, arrays | changed, 0))
        try:
            TABLES.read(graph, path)
        except TableError:
            return True
        return False

    outside = {
        "tried": (-1, 1 << 12), "branch": (-1, 8), "mask_index": (len(arrays["mask"]),),
        "manipulability_index": (-1, len(arrays["manipulability"])),
        "lost_index": (len(arrays["lost"]),),
    }  # fmt: skip
    assert not is_refused()
    for name, values in outside.items():
        for value in values:
            changed = arrays[name].astype(np.int64)
            changed.flat[changed.argmax()] = value
            assert is_refused(**{name: changed}), (name, value)
