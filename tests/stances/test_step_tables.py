"""Step tables: with points taken away, of any content, and the names of their files."""

from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym import Settings, robot_spec, stance_graph
from mlivr_gym.stances.step_tables import StepTables, step_tables, without_points
from mlivr_gym.stances.table_file import TABLES
from mlivr_gym.stances.table_steps import LookaheadGoals, write_action_lookahead

pytestmark = pytest.mark.usefixtures("empty_cache")


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


def test_the_cache_tells_robots_maps_and_settings_apart(small_map):
    """Whatever decides on a step is in the name of the file."""
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


POINTS = 6


def random_tables(rng):
    """Steps between every two stances that share a point, some left out; few bits in the branch
    sets."""
    points = [(a, b) for a in range(POINTS) for b in range(POINTS) if a != b]
    points = [points[k] for k in sorted(rng.choice(len(points), 18, replace=False))]
    n, start, after, to_point, kept = len(points), [0], [], [], []
    for s in range(n):
        for moving in range(2):
            for s2 in sorted(range(n), key=lambda s2, j=moving: points[s2][j]):
                same = points[s2][1 - moving] == points[s][1 - moving]
                if s2 != s and same and rng.random() < 0.7:
                    after.append(s2)
                    to_point.append(points[s2][moving])
                    kept.append(int(rng.integers(1, 8)))
            start.append(len(after))
    return StepTables(
        np.array(points, dtype=np.int32), rng.normal(size=(n, 3)),
        rng.integers(0, 8, (n, 2)).astype(np.int32), rng.integers(0, 8, (n, 2)).astype(np.int32),
        np.array(start), np.array(after, dtype=np.int32), np.array(to_point, dtype=np.uint16),
        np.array(kept, dtype=np.uint16),
    )  # fmt: skip


def plain_steps(tables, s, branch_sets):
    """Limb, index of the step, stance after it, and what the other limb keeps."""
    out = []
    for moving in range(2):
        if not branch_sets[moving] & tables.releasable[s, moving]:
            continue
        for e in range(tables.start[2 * s + moving], tables.start[2 * s + moving + 1]):
            kept = int(branch_sets[1 - moving] & tables.kept[e])
            if kept:
                out.append((moving, e, int(tables.after[e]), kept))
    return out


@pytest.mark.parametrize("seed", range(5))
def test_where_the_steps_after_an_action_lead(seed):
    rng = np.random.default_rng(seed)
    tables, k, depth = random_tables(rng), 12, 2
    stances, branch_sets = rng.integers(0, len(tables.points), k), rng.integers(0, 8, (k, 2))
    goals, free = rng.normal(size=(k, 3)), rng.random((k, POINTS)) < 0.8
    of_points = rng.random((k, 2, POINTS, 2 * depth)) * 3.0
    found = np.zeros((k, 2, POINTS, 2 * depth + 2))
    found[..., : depth + 1] = 2.5
    expected = found.copy()
    write_action_lookahead(
        stances, branch_sets, tables, LookaheadGoals(goals, 1.5, free, of_points), found
    )
    for i in range(k):
        for moving, _, s2, kept in plain_steps(tables, stances[i], branch_sets[i]):
            grasped = int(tables.releasable[s2, moving])
            after = (grasped, kept) if moving == 0 else (kept, grasped)
            out = expected[i, moving, tables.points[s2, moving]]
            for limb, _, s3, _ in plain_steps(tables, s2, after):
                point = tables.points[s3, limb]
                if free[i, point]:
                    away = np.linalg.norm(tables.base_position[s3] - goals[i])
                    ahead = of_points[i, limb, point]
                    out[: depth + 1] = np.minimum(out[: depth + 1], [away, *ahead[:depth]])
                    out[depth + 1 :] += [away <= 1.5, *ahead[depth:]]
    np.testing.assert_allclose(found, expected, atol=1e-12)
