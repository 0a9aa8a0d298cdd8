"""Steps in tables of any content against loops over lists of Python."""

import numpy as np
import pytest

from mlivr_gym.stances.step_tables import StepTables
from mlivr_gym.stances.table_steps import LookaheadGoals, write_action_lookahead

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
