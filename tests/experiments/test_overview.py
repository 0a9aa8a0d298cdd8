"""The overview shows edges of the stance graph."""

import importlib

import numpy as np
import pytest


@pytest.fixture(scope="module")
def module(experiments):
    return importlib.import_module("overview")


def test_the_edges_drawn_are_edges(module, checked_graph, monkeypatch):
    monkeypatch.setattr(module, "EDGES", 20)
    for first, last in module.edge_paths(checked_graph):
        s, t = (
            np.flatnonzero((checked_graph.base_position == end).all(axis=1))
            for end in (first, last)
        )
        found = [
            (a, b)
            for a in s
            for b in t
            for held in range(2)
            if checked_graph.points[a, held] == checked_graph.points[b, held]
            and checked_graph.kept_branches(held, int(a), np.array([b]))[0]
        ]
        assert found
