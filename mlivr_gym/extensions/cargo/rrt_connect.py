"""RRT-Connect (Kuffner and LaValle 2000) between joint angles of one limb."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mlivr_gym.arrays import Array

EXTENSION = 0.4
"""Longest line by which a tree grows [rad]."""

MOST_SAMPLES, SHORTCUTS = 1500, 60
"""Samples, and random shortcuts that are tried on what was found."""

IsLineClear = Callable[[Array, Array], bool]
"""Whether a limb can move on a line between two postures, each of shape (6,) [rad]."""

Tree = list[tuple[Array, int]]
"""Nodes, each with the number of the one that it grew from, -1 for the root."""


def connected(
    first: Array, last: Array, limits: Array, is_line_clear: IsLineClear, seed: int = 0
) -> Array | None:
    """Return knots of a clear path between joint angles (6,), shape (k, 6) [rad], or None.

    Joints stay within `limits`, shape (6, 2) [rad].
    """
    if not (is_line_clear(first, first) and is_line_clear(last, last)):
        return None
    if is_line_clear(first, last):
        return np.array([first, last])
    rng, trees = np.random.default_rng(seed), ([(first, -1)], [(last, -1)])
    for k in range(MOST_SAMPLES):
        here, there = trees[k % 2], trees[1 - k % 2]
        if _extend(here, rng.uniform(limits[:, 0], limits[:, 1]), is_line_clear):
            target = here[-1][0]
            while _extend(there, target, is_line_clear):
                if np.abs(there[-1][0] - target).max() < 1e-9:
                    path = _to_root(trees[0], -1)[::-1] + _to_root(trees[1], -1)[1:]
                    return _shortened(path, is_line_clear, rng)
    return None


def _extend(tree: Tree, target: Array, is_line_clear: IsLineClear) -> bool:
    """Add a node towards a target to a tree, if the line to it is clear."""
    away = np.abs(np.array([node for node, _ in tree]) - target).max(axis=1)
    nearest = int(np.argmin(away))
    start, size = tree[nearest][0], float(away[nearest])
    if size < 1e-12:
        return False
    end = start + min(1.0, EXTENSION / size) * (target - start)
    if not is_line_clear(start, end):
        return False
    tree.append((end, nearest))
    return True


def _shortened(path: list[Array], is_line_clear: IsLineClear, rng: np.random.Generator) -> Array:
    """Return a path without knots that a clear line can replace."""
    for _ in range(SHORTCUTS):
        if len(path) < 3:
            break
        a, b = sorted(rng.choice(len(path), 2, replace=False).tolist())
        if b > a + 1 and is_line_clear(path[a], path[b]):
            path = path[: a + 1] + path[b:]
    return np.array(path)


def _to_root(tree: Tree, node: int) -> list[Array]:
    """Return the nodes from one of a tree to its root."""
    nodes = []
    node %= len(tree)
    while node >= 0:
        joints, node = tree[node]
        nodes.append(joints)
    return nodes
