"""Labels of the overview stand where the scene shows what they name."""

import importlib

import numpy as np
import pytest

from mlivr_gym.planners import Planner


@pytest.fixture(scope="module")
def module(experiments):
    return importlib.import_module("overview")


@pytest.fixture(scope="module")
def drawing(module, checked_graph):
    plan = Planner(checked_graph).plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()
    try:
        drawing = module.Drawing(checked_graph)
    except Exception as error:  # GL loaders raise errors of many kinds
        pytest.skip(f"no GL library: {error}")
    drawing.place(plan, 0)
    return drawing


@pytest.mark.parametrize("point", [(2.0, 0.2, 0.3), (4.5, -0.5, -0.4), (6.0, 0.6, 0.8)])
def test_a_label_stands_where_the_renderer_draws_its_point(drawing, point):
    """The middle of what a ball changes in the picture; a ball off the axis is drawn a bit oval."""
    before = drawing.image().astype(int)
    drawing.ball(np.array(point), 0.03, "#ff00ff")
    changed = np.abs(drawing.image().astype(int) - before).sum(axis=2) > 60
    drawing.renderer.scene.ngeom -= 1
    rows, columns = np.nonzero(changed)
    assert len(rows) > 30
    x, y = drawing.seen(np.array(point))
    assert columns.mean() == pytest.approx(x, abs=1.5)
    assert rows.mean() == pytest.approx(y, abs=1.5)


def test_the_edges_drawn_are_edges(module, checked_graph, monkeypatch):
    monkeypatch.setattr(module, "EDGES", 20)
    for first, last in module.edge_paths(checked_graph):
        s, t = (
            np.flatnonzero((checked_graph.base_in_world == end).all(axis=1))
            for end in (first, last)
        )
        found = [
            (a, b)
            for a in s
            for b in t
            for held in range(2)
            if checked_graph.points[a, held] == checked_graph.points[b, held]
            and checked_graph.edge_masks(held, int(a), np.array([b]))[0]
        ]
        assert found
