"""Measure how long 10,000 points of a depth camera take until the stance graph has them.

    python experiments/point_clouds.py [--out results] [--points 10000] [--repeats 20]

The points are those that a camera measures of a wall, of a ball and of crates, or they fill a cube
of 2 m, which no camera sees. `boxes` covers them and `graph` adds the boxes to a graph without any;
`hits` and `update` are those of a robot that believes what it sees, whose first look they are, and
`again` is a further look. Writes `point_clouds.json`, whose table `readme.py` shows in the docs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from reports import experiment, table

from mlivr_gym import stance_graph
from mlivr_gym.arrays import Array
from mlivr_gym.closed_loop.belief import Belief
from mlivr_gym.closed_loop.depth_camera import DepthCamera
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.world.covering_boxes import point_cloud_boxes

STANCE = ("D2a:4", "D2b:4")
NOISE = DepthCamera().noise
HEAD = (
    "points of | boxes | boxes made | added to the graph | first look: hits | graph | "
    "another look: hits | graph"
)


def clouds(count: int, rng: np.random.Generator) -> dict[str, Array]:
    """Return points by what they are of, shape (count, 3) [m]."""
    sides = rng.normal(size=(count, 3))
    balls = 0.35 * sides / np.linalg.norm(sides, axis=1)[:, None]
    faces = rng.uniform(-0.25, 0.25, (count, 3))
    faces[np.arange(count), rng.integers(3, size=count)] = 0.25
    at = np.array([(3.2, -0.6, 0.4), (4.1, 0.3, -0.3), (4.9, -0.2, 0.5), (5.6, 0.6, 0.1)])
    found = {
        "a wall": rng.uniform((4.5, -1.0, -1.0), (4.5, 1.0, 1.0), (count, 3)),
        "a ball": balls + np.array([4.5, 0.0, 0.2]),
        "four crates": faces + at[rng.integers(len(at), size=count)],
        "2 m of clutter": rng.uniform((4.0, -1.0, -1.0), (6.0, 1.0, 1.0), (count, 3)),
    }
    return {name: one + NOISE * rng.normal(size=one.shape) for name, one in found.items()}


def milliseconds(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of a call [ms], and its result."""
    began = time.process_time()
    found = call()
    return 1e3 * (time.process_time() - began), found


def times(graph: TwoLimbGraph, here: Configuration, points: Array) -> tuple[list[float], int]:
    """Return the time of each stage [ms], and the number of boxes."""
    graph.remove_obstacles()
    made, boxes = milliseconds(lambda: point_cloud_boxes(points))
    found = [made, milliseconds(lambda: graph.add_obstacles(boxes))[0]]
    graph.remove_obstacles()
    belief, state = Belief(graph, NOISE), graph.state(STANCE)
    for look in (points, points + 0.01):
        found.append(milliseconds(lambda seen=look: belief.add_hits(seen, here))[0])
        found.append(milliseconds(lambda: belief.update_graph(state))[0])
    belief.withdraw()
    return found, len(boxes)


def measured(points: int, repeats: int) -> dict[str, Any]:
    """Return the number of boxes of each cloud, and the median time of each stage [ms]."""
    graph = stance_graph()
    assert isinstance(graph, TwoLimbGraph)
    here, rows = graph.configuration(graph.state(STANCE)), {}
    for name, cloud in clouds(points, np.random.default_rng(0)).items():
        found = [times(graph, here, cloud) for _ in range(repeats + 1)][1:]
        median = np.median([stages for stages, _ in found], axis=0)
        rows[name] = {"boxes": found[0][1], "milliseconds": median.tolist()}
    return {"points": points, "clouds": rows}


def markdown(data: dict[str, Any]) -> str:
    """Return the table for the page on obstacles."""
    return table(HEAD, (
        (name, f"{row['boxes']:,}", *(f"{stage:.1f}" for stage in row["milliseconds"]))
        for name, row in data["clouds"].items()
    ))  # fmt: skip


if __name__ == "__main__":
    experiment("point_clouds", __doc__, measured, points=10_000, repeats=20)
