"""The command `info`."""

import json
import re

import numpy as np
from scipy.sparse.csgraph import connected_components

from mlivr_gym import stance_graph


def test_info_counts(run):
    code, out, _ = run("info")
    assert code == 0
    assert "331 points on 46 tracks" in out
    assert "43540" in out
    assert "handrails: 18" in out
    code, out, _ = run("info", "--robot", "mlivr4")
    assert code == 0
    assert "4 limbs" in out


def test_every_count_of_the_stance_graph_is_that_of_its_stances(run, tmp_path, ladder):
    """Steps and connected parts by comparing all pairs of stances, SciPy's components."""
    world = tmp_path / "ladder.json"
    world.write_text(json.dumps(ladder.to_dict()))
    code, out, _ = run("info", "--map", str(world))
    assert code == 0
    graph = stance_graph(ladder)
    points, bases = graph.points, graph.base_in_world
    one = (points[:, None] != points[None]).sum(axis=2) == 1
    told = re.search(r"(\d+) steps before checks, (\d+) connected parts, the largest of (\d+)", out)
    count, part = connected_components(one, directed=False)
    assert [int(n) for n in told.groups()] == [one.sum(), count, np.bincount(part).max()]
    longest = np.linalg.norm(bases[:, None] - bases[None], axis=2)[one].max()
    assert f"longest base displacement of a step: {longest:.3f} m" in out
    states = [graph.state(stance) for stance in points.tolist()]
    postures = graph.postures_of(states)
    low, high = postures.w_m.min(), postures.w_m.max()
    assert f"w_m {low:.4f} to {high:.4f}, " in out
    pairs = int(re.search(r"ordered pairs of points within span: (\d+)", out)[1])
    numbers = re.search(r"(\d+) of \d+ pairs in reach, (\d+) stances", out).groups()
    reach, stances = map(int, numbers)
    assert stances == len(points)
    causes = re.search(r"left out by cause: (.*)", out)[1]
    left_out = {name: int(number) for name, number in (c.split() for c in causes.split(", "))}
    assert sum(left_out.values()) == pairs - stances
    assert left_out["reach"] == pairs - reach
