"""The command `info`."""

import json

import numpy as np
from scipy.sparse.csgraph import connected_components

from mlivr_gym import stance_graph


def test_the_module_and_its_robots_are_told(run):
    told = json.loads(run("info", "--json")[1])
    counts = told["map"]["points"], told["map"]["segments"], told["map"]["handrails"]
    assert counts == (331, 46, 18)
    assert told["stance_graph"]["pairs_within_span"] == 43540
    text = run("info")[1]
    assert "  pairs within span: 43540\n" in text
    assert "\n  w_m: 0.1" in text  # a symbol, not words


def test_every_count_of_the_stance_graph_is_that_of_its_stances(run, tmp_path, ladder):
    """Steps and connected parts by comparing all pairs of stances, SciPy's components."""
    world = tmp_path / "ladder.json"
    world.write_text(json.dumps(ladder.to_dict()))
    told = json.loads(run("info", "--map", str(world), "--json")[1])["stance_graph"]
    graph = stance_graph(ladder)
    points, bases = graph.points, graph.base_position
    one = (points[:, None] != points[None]).sum(axis=2) == 1
    count, part = connected_components(one, directed=False)
    assert told["steps_before_checks"] == one.sum()
    assert told["connected_parts"] == count
    assert told["stances_of_the_largest_part"] == np.bincount(part).max()
    longest = np.linalg.norm(bases[:, None] - bases[None], axis=2)[one].max()
    assert abs(told["longest_step"] - longest) < 1e-12
    postures = graph.postures_of([graph.state(stance) for stance in points.tolist()])
    np.testing.assert_allclose(told["w_m"], [postures.w_m.min(), postures.w_m.max()], rtol=1e-12)
    left_out = told["stances_left_out"]
    assert told["stances"] == len(points)
    assert sum(left_out.values()) == told["pairs_within_span"] - len(points)
    assert left_out["reach"] == told["pairs_within_span"] - told["stances_reachable"]
