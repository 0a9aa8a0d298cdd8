"""Where three and four limbs can walk in the JEM, found by exploration, and what limits it.

    python experiments/connectivity.py [--out results] [--expansions 6000]

From one random stance the stance graph is explored with collisions checked: again and again a state
is expanded whose base lies where the fewest were expanded before. Some of the steps are tried the
other way round. Then neighbours of some stances are counted by what they fail, and the shortest
walk whose stances were explored is looked for from one on the deck to one on the overhead. Writes
`connectivity.json`, `connectivity.md` and `connectivity.png`.
"""

from __future__ import annotations

import argparse
import heapq
import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from tqdm import trange

from mlivr_gym import Settings, stance_graph
from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.files import write_whole
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.figures import save_figure
from mlivr_gym.planners.walks import plan_of
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.transitions.rule import can_release
from mlivr_gym.transitions.state import State

ROBOTS = ("mlivr3", "mlivr4")

CELL = 0.25
"""Edge of the cubes in which expansions are counted [m]."""

POSED, CHECKED = 64, 24
"""Most neighbours of an expanded state whose postures, and to which steps, are worked out."""

KEPT = 0.7
"""Probability that a state may be expanded once more."""

SAMPLE = 40
"""Stances whose neighbours are counted."""

BACK = 200
"""Steps that are tried the other way round."""

COLOURS = {"deck": "#1f77b4", "overhead": "#d62728", "forward": "#2ca02c", "aft": "#9467bd"}
MIXED = "#aaaaaa"


@dataclass
class Explored:
    """Stances that were reached.

    Attributes:
        states: A state of each.
        postures: Their postures.
        edges: Pairs of stances that a step joins, by index.
    """

    states: list[State] = field(default_factory=list)
    postures: list[Postures] = field(default_factory=list)
    edges: list[tuple[int, int]] = field(default_factory=list)
    index: dict[tuple[int, ...], int] = field(default_factory=dict)

    def add(self, state: State, posture: Postures) -> tuple[int, bool]:
        """Index of a state's stance, and whether it is new."""
        new = state.stance not in self.index
        if new:
            self.index[state.stance] = len(self.states)
            self.states.append(state)
            self.postures.append(posture)
        return self.index[state.stance], new

    @property
    def stances(self) -> IntArray:
        """Points of the stances, shape (k, N)."""
        return np.array([state.stance for state in self.states], dtype=np.int64)

    @property
    def bases(self) -> Array:
        """Base positions, shape (k, 3) [m]."""
        return np.concatenate([posture.base_position for posture in self.postures])


def explore(graph: LazyGraph, expansions: int, rng: np.random.Generator) -> Explored:
    """Expand states, always one of those whose surroundings were seen the least."""
    found, counts = Explored(), Counter[tuple[int, ...]]()
    cells: dict[tuple[int, ...], list[int]] = {}

    def put(state: State, posture: Postures) -> int:
        k, new = found.add(state, posture)
        if new:
            cell = np.floor(posture.base_position[0] / CELL).astype(int)
            cells.setdefault(tuple(cell.tolist()), []).append(k)
        return k

    first = random_state(graph, rng)
    put(first, graph.posture_of(first))
    for _ in trange(expansions, desc=graph.robot.name, mininterval=5.0):
        cell = min((c for c in cells if cells[c]), key=lambda c: counts[c] + rng.random() / 2.0)
        k = cells[cell].pop(int(rng.integers(len(cells[cell]))))
        counts[cell] += 1
        if rng.random() < KEPT:
            cells[cell].append(k)
        state, posture = found.states[k], found.postures[k]
        stances = rng.permutation(graph.neighbours(state, posture))[:POSED]
        postures = graph.nodes(stances)
        nodes = np.flatnonzero(graph.is_node(postures))[:CHECKED]
        after = postures.take(nodes)
        every = np.zeros(len(nodes), dtype=np.int64)
        masks = graph.masks_after([state], posture, every, stances[nodes], after)
        for n in np.flatnonzero(masks.all(axis=1)):
            stance = tuple(stances[nodes[n]].tolist())
            there = put(State(stance, tuple(masks[n].tolist())), after.take(np.array([n])))
            found.edges.append((k, there))
    return found


def faces_of(graph: LazyGraph, stances: IntArray) -> list[tuple[str, ...]]:
    """Faces that each stance holds."""
    faces = np.array(graph.grasp_map.faces)
    return [tuple(sorted(set(row))) for row in faces[stances].tolist()]


def within_span(graph: LazyGraph, state: State, posture: Postures) -> IntArray:
    """Stances one move from a state of which only the distances of the points are known, (k, N)."""
    stances = [np.zeros((0, graph.limbs), dtype=np.int64)]
    for limb, held in enumerate(state.stance):
        if can_release(state.masks[limb], graph.released(state.stance, posture, limb)):
            able = graph.together[np.delete(state.stance, limb)].all(axis=0)
            able[held] = False
            points = np.flatnonzero(able)
            stances.append(np.tile(state.stance, (len(points), 1)))
            stances[-1][:, limb] = points
    return np.concatenate(stances)


def limits(graph: LazyGraph, found: Explored, rng: np.random.Generator) -> dict[str, Any]:
    """Neighbours of some stances, counted by the first of the conditions that they fail."""
    free = stance_graph(
        robot=graph.robot, settings=Settings(manipulability=False, collisions=False)
    )
    limb, base = graph.limb_threshold, graph.base_threshold
    counts, shares = Counter[str](), []
    for k in rng.choice(len(found.states), SAMPLE, replace=False).tolist():
        state, posture = found.states[k], found.postures[k]
        stances = within_span(graph, state, posture)
        loose, real = free.postures(stances), graph.nodes(stances)
        reachable = free.is_node(loose)
        dexterous = reachable & (loose.w_m.min(axis=1) >= limb)
        both = dexterous & (loose.w_b >= base)
        node = graph.is_node(real)
        shares += (loose.w_b[dexterous] / base).tolist()
        every = np.zeros(int(node.sum()), dtype=np.int64)
        masks = graph.masks_after([state], posture, every, stances[node], real.take(node))
        for name, rows in (("all", np.ones(len(stances), dtype=np.bool_)), ("reachable", reachable),
                           ("limb", dexterous), ("base", both), ("node", node)):  # fmt: skip
            counts[name] += int(rows.sum())
        counts["step"] += int(masks.all(axis=1).sum())
    return {"counts": dict(counts), "w_b": np.quantile(shares, (0.05, 0.25, 0.5)).tolist()}


def gone_back(graph: LazyGraph, found: Explored, rng: np.random.Generator) -> tuple[int, int]:
    """How many of some steps can be gone back at once, and how many were tried."""
    tried = back = 0
    for n in rng.choice(len(found.edges), min(BACK, len(found.edges)), replace=False).tolist():
        before, after = (found.states[k] for k in found.edges[n])
        there = graph.step_to(before, after.stance)
        if there is not None:
            tried += 1
            back += graph.step_to(there, before.stance) is not None
    return back, tried


def walk_between(graph: LazyGraph, found: Explored, start: str, end: str) -> Plan | None:
    """The shortest walk through explored stances from one wholly on a face to one on another.

    The branches that limbs are on narrow on the way, so each step is checked again: this may
    take minutes. None if there is none.
    """
    faces = faces_of(graph, found.stances)
    first, last = ([k for k, f in enumerate(faces) if f == (name,)] for name in (start, end))
    if not first or not last:
        return None
    pairs = np.array(found.edges, dtype=np.int64)
    count = len(found.states)
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count)).tocsr()
    to_go = dijkstra(links, directed=False, indices=last, unweighted=True, min_only=True)
    beside: dict[int, set[int]] = {}
    for a, b in pairs.tolist():
        beside.setdefault(a, set()).add(b)
        beside.setdefault(b, set()).add(a)
    queue: list[tuple[float, int, int, tuple[State, ...]]] = []
    for k in first:
        heapq.heappush(queue, (to_go[k], 0, k, (graph.state(found.states[k].stance),)))
    seen: set[State] = set()
    while queue:
        _, deep, k, states = heapq.heappop(queue)
        steps = -deep
        # The step to stance k is checked when its turn has come.
        after = states[0] if not steps else graph.step_to(states[-1], found.states[k].stance)
        if after is None or after in seen:
            continue
        seen.add(after)
        walk = (*states, after) if steps else states
        if to_go[k] == 0.0:
            plan = plan_of(graph, walk, found.bases[k], 0.2, "exploration", len(seen))
            if plan is not None:
                return plan
        for there in sorted(beside[k]):
            heapq.heappush(queue, (steps + 1 + to_go[there], -steps - 1, there, walk))
    return None


def explored(robot: str, expansions: int) -> dict[str, Any]:
    """What is told of a robot."""
    graph, rng = stance_graph(robot=robot), np.random.default_rng(0)
    assert isinstance(graph, LazyGraph)
    found = explore(graph, expansions, rng)
    plan = walk_between(graph, found, "deck", "overhead")
    faces, bases = faces_of(graph, found.stances), found.bases
    held = Counter("+".join(face) for face in faces)
    shown = rng.permutation(len(bases))[:4000]
    return {
        "expansions": expansions,
        "stances": len(found.states),
        "steps": len({tuple(sorted(pair)) for pair in found.edges}),
        "held": dict(held.most_common()),
        "least": bases.min(axis=0).tolist(),
        "most": bases.max(axis=0).tolist(),
        "bases": np.round(bases[shown], 3).tolist(),
        "faces": [faces[k][0] if len(faces[k]) == 1 else "" for k in shown.tolist()],
        "limits": limits(graph, found, rng),
        "back": gone_back(graph, found, rng),
        "walk": None if plan is None else len(plan.steps),
    }


def markdown(data: dict[str, Any]) -> str:
    """The report."""
    lines = [
        "# Where three and four limbs can walk",
        "",
        "Made by `experiments/connectivity.py`: the JEM, collisions checked, explored from one "
        "random stance. What was not reached may be reachable too. *Gone back*: steps that can be "
        "taken back at once, of those tried.",
        "",
        "![Base positions that were reached](connectivity.png)",
        "",
        "| robot | states expanded | stances reached | steps found | base along the module, x [m] "
        "| wholly on the deck | on the overhead | forward | aft | on several faces "
        "| gone back | fewest steps found, deck to overhead |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for robot in ROBOTS:
        one = data[robot]
        held = [one["held"].get(face, 0) for face in COLOURS]
        walk = "none" if one["walk"] is None else one["walk"]
        lines.append(
            f"| `{robot}` | {one['expansions']:,} | {one['stances']:,} | {one['steps']:,} "
            f"| {one['least'][0]:.2f} to {one['most'][0]:.2f} | "
            + " | ".join(f"{count:,}" for count in held)
            + f" | {one['stances'] - sum(held):,} | {one['back'][0]} of {one['back'][1]} | {walk} |"
        )
    lines += [
        "",
        "## What limits it",
        "",
        f"Neighbours of {SAMPLE} of these stances, by moves of limbs that can be released: the "
        "share that meets each condition and those before it. Manipulability is that of the "
        "posture with the largest margin, of those that may touch something. The last column is "
        "the base manipulability of neighbours whose limbs are above theirs, over its threshold "
        "`0.001 (2/N)^3`: 5 %, 25 % and 50 % lie below.",
        "",
        "| robot | within the span | in reach | `w_m` | `w_b` | touch nothing: nodes | steps "
        "| `w_b` over its threshold |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for robot in ROBOTS:
        found = data[robot]["limits"]
        counts = found["counts"]
        shares = [
            f"{counts[name] / counts['all']:.1%}"
            for name in ("reachable", "limb", "base", "node", "step")
        ]
        spread = ", ".join(f"{value:.1f}" for value in found["w_b"])
        lines.append(f"| `{robot}` | {counts['all']:,} | " + " | ".join(shares) + f" | {spread} |")
    return "\n".join(lines) + "\n"


def picture(data: dict[str, Any], path: Path) -> None:
    """Base positions from the side and from above, in the colour of the face that is held."""
    figure = Figure(figsize=(11.0, 5.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    for column, robot in enumerate(ROBOTS):
        bases, faces = np.array(data[robot]["bases"]), np.array(data[robot]["faces"])
        for row, (axis, name) in enumerate(((2, "z, to the overhead"), (1, "y, aft"))):
            plot = axes[row, column]
            for face, colour in {"": MIXED, **COLOURS}.items():
                rows = bases[faces == face]
                plot.scatter(rows[:, 0], rows[:, axis], s=3, color=colour, linewidths=0,
                             label=face or "several faces")  # fmt: skip
            plot.set_aspect("equal")
            plot.set_ylabel(f"{name} [m]")
            plot.grid(alpha=0.3)
        axes[0, column].set_title(f"{robot}: bases of {len(bases):,} of the stances reached")
        axes[1, column].set_xlabel("x, along the module [m]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncol=5,
                  markerscale=4.0, title="all limbs hold")  # fmt: skip
    save_figure(figure, path)


def main() -> None:
    """Explore and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("results"))
    parser.add_argument("--expansions", type=int, default=6000)
    args = parser.parse_args()
    data: dict[str, Any] = {}
    for robot in ROBOTS:
        data[robot] = explored(robot, args.expansions)
    write_whole(args.out / "connectivity.json", json.dumps(data) + "\n")
    write_whole(args.out / "connectivity.md", markdown(data))
    picture(data, args.out / "connectivity.png")


if __name__ == "__main__":
    main()
