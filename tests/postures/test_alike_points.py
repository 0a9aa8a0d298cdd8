"""Points in modules that are alike: their stances are treated once, and are what they are alone."""

from dataclasses import fields

import numpy as np
import pytest

from mlivr_gym import Settings, stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.postures import solver
from mlivr_gym.postures.alike_points import classes_of_points
from mlivr_gym.postures.postures import Postures
from mlivr_gym.world.grasp_map import as_map

QUARTER = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
FIRST, SECOND, THIRD = "a/", "b/", "c/"


@pytest.fixture(scope="module")
def row():
    """Three nodes far from each other, the second turned, with a box in the third."""
    node = str(asset_path("node.json"))
    parts = [
        {"id": "a", "map": node},
        {"id": "b", "map": node, "translation": [20.0, 0.3, 0.1], "rotation": QUARTER},
        {"id": "c", "map": node, "translation": [40.0, 0.0, 0.0]},
    ]
    crate = {"id": "crate", "min": [40.6, 0.3, -0.9], "max": [40.9, 0.6, -0.6]}
    return as_map({"name": "row", "parts": parts, "boxes": [crate]})


def test_points_are_alike_in_turned_modules_and_not_where_a_box_is_near(row):
    classes = classes_of_points(row, 1.0)
    first, second, third = (
        np.array([point.startswith(name) for point in row.ids]) for name in (FIRST, SECOND, THIRD)
    )
    np.testing.assert_array_equal(classes[first], classes[second])
    box = np.array([40.75, 0.45, -0.75])
    away = np.linalg.norm(np.maximum(np.abs(row.positions[third] - box) - 0.15, 0.0), axis=1)
    differs = classes[first] != classes[third]
    assert differs[away < 1.0].all()
    assert not differs[away > np.sqrt(3.0)].any()
    assert differs.any()
    assert not differs.all()


@pytest.mark.parametrize("transitions", [False, True])
def test_their_stances_are_those_that_are_found_one_by_one(row, monkeypatch, transitions):
    settings, found = Settings(transitions=transitions), []
    for least in (10**9, 0):
        monkeypatch.setattr(solver, "LEAST_ALIKE", least)
        found.append(stance_graph(row, settings=settings))
    alone, shared = found
    np.testing.assert_array_equal(alone.points, shared.points)
    assert sum(alone.removed.values()) == sum(shared.removed.values()) > 0
    at = np.arange(len(alone))
    for name in (field.name for field in fields(Postures)):
        one, other = (getattr(graph.node_postures(at), name) for graph in found)
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-15, err_msg=name)
    counts = [
        sum(graph.grasp_map.ids[a].startswith(name) for a in graph.points[:, 0])
        for graph in found
        for name in (FIRST, SECOND, THIRD)
    ]
    assert counts[3] == counts[4] > counts[5]
