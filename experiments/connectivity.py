"""Explore where robots with three and four limbs can walk in the JEM, and what limits them.

    python experiments/connectivity.py [--out results] [--expansions 6000]

Starting from one random state with collisions checked, the search repeatedly expands a state in the
region of base positions with the fewest expansions so far. Then the neighbours of random stances
are counted by the first condition that they fail. Writes `connectivity.json`, `connectivity.md` and
`connectivity.png`.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from reports import command_line, publish, table
from tqdm import trange

from mlivr_gym import Settings, stance_graph
from mlivr_gym.arrays import IntArray
from mlivr_gym.pictures.figures import save_figure
from mlivr_gym.postures.postures import Postures
from mlivr_gym.stances.implicit_graph import ImplicitGraph
from mlivr_gym.stances.random_states import random_state
from mlivr_gym.transitions.rule import can_release
from mlivr_gym.transitions.state import State

ROBOTS = ("mlivr3", "mlivr4")

CELL = 0.25
"""Edge length of the cubes in which expansions are counted [m]."""

POSED, CHECKED = 64, 24
"""Maximum number of neighbours of a state whose postures, and whose steps, are computed."""

KEPT = 0.7
"""Probability that an expanded state can be expanded again."""

SAMPLE = 40
"""Number of stances whose neighbours are counted."""

CONDITIONS = ("reachable", "limb", "base", "node", "step")
"""Conditions on a neighbour; each includes those before it."""

REACHED = (
    "robot | states expanded | stances reached | steps found | base along the module, x [m] | "
    "wholly on the deck | on the overhead | forward | aft | on several faces"
)
LIMITING = (
    "robot | within the span | in reach | `w_m` | `w_b` | touch nothing: nodes | steps | "
    "`w_b` over its threshold"
)
"""Heads of the tables."""

COLOURS = {"deck": "#1f77b4", "overhead": "#d62728", "forward": "#2ca02c", "aft": "#9467bd"}
MIXED = "#aaaaaa"


class Explored(NamedTuple):
    """Stances that the exploration reached."""

    states: list[State]
    """A state of each stance."""
    postures: list[Postures]
    """Posture of each stance."""
    steps: set[frozenset[int]]
    """Pairs of stances, by index, that a step joins."""


def explore(graph: ImplicitGraph, expansions: int, rng: np.random.Generator) -> Explored:
    """Expand states, always in the region with the fewest expansions."""
    found, counts = Explored([], [], set()), Counter[tuple[int, ...]]()
    index: dict[tuple[int, ...], int] = {}
    cells: dict[tuple[int, ...], list[int]] = {}

    def put(state: State, posture: Postures) -> int:
        if state.stance not in index:
            index[state.stance] = len(index)
            found.states.append(state)
            found.postures.append(posture)
            cell = np.floor(posture.base_position[0] / CELL).astype(int)
            cells.setdefault(tuple(cell.tolist()), []).append(index[state.stance])
        return index[state.stance]

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
        branch_sets = graph.branch_sets_after([state], posture, every, stances[nodes], after)
        for n in np.flatnonzero(branch_sets.all(axis=1)):
            stance = tuple(stances[nodes[n]].tolist())
            there = put(State(stance, tuple(branch_sets[n].tolist())), after.take(np.array([n])))
            found.steps.add(frozenset((k, there)))
    return found


def within_span(graph: ImplicitGraph, state: State, posture: Postures) -> IntArray:
    """Return the stances one move from a state that distances alone allow, shape (k, N)."""
    stances = [np.zeros((0, graph.limbs), dtype=np.int64)]
    for limb, held in enumerate(state.stance):
        if can_release(
            state.branch_sets[limb], graph.releasable_branches(state.stance, posture, limb)
        ):
            able = graph.compatible[np.delete(state.stance, limb)].all(axis=0)
            able[held] = False
            points = np.flatnonzero(able)
            stances.append(np.tile(state.stance, (len(points), 1)))
            stances[-1][:, limb] = points
    return np.concatenate(stances)


def limits(graph: ImplicitGraph, found: Explored, rng: np.random.Generator) -> dict[str, Any]:
    """Count the neighbours of random stances that meet each condition."""
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
        branch_sets = graph.branch_sets_after(
            [state], posture, every, stances[node], real.take(node)
        )
        step = branch_sets.all(axis=1)
        counts["all"] += len(stances)
        for name, met in zip(CONDITIONS, (reachable, dexterous, both, node, step), strict=True):
            counts[name] += int(met.sum())
    return {"counts": dict(counts), "w_b": np.quantile(shares, (0.05, 0.25, 0.5)).tolist()}


def explored(robot: str, expansions: int) -> dict[str, Any]:
    """Return the results for a robot."""
    graph, rng = stance_graph(robot=robot), np.random.default_rng(0)
    assert isinstance(graph, ImplicitGraph)
    found = explore(graph, expansions, rng)
    bases = np.concatenate([posture.base_position for posture in found.postures])
    sides = graph.grasp_map.faces
    faces = [sorted({sides[point] for point in state.stance}) for state in found.states]
    held = Counter("+".join(face) for face in faces)
    shown = rng.permutation(len(bases))[:4000]
    return {
        "expansions": expansions,
        "stances": len(found.states),
        "steps": len(found.steps),
        "held": dict(held.most_common()),
        "least": bases.min(axis=0).tolist(),
        "most": bases.max(axis=0).tolist(),
        "bases": np.round(bases[shown], 3).tolist(),
        "faces": [faces[k][0] if len(faces[k]) == 1 else "" for k in shown.tolist()],
        "limits": limits(graph, found, rng),
    }


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    reached, limiting = [], []
    for robot in ROBOTS:
        one, counts = data[robot], data[robot]["limits"]["counts"]
        held = [one["held"].get(face, 0) for face in COLOURS]
        reached.append([
            f"`{robot}`", f"{one['expansions']:,}", f"{one['stances']:,}", f"{one['steps']:,}",
            f"{one['least'][0]:.2f} to {one['most'][0]:.2f}", *(f"{count:,}" for count in held),
            f"{one['stances'] - sum(held):,}",
        ])  # fmt: skip
        shares = [f"{counts[name] / counts['all']:.1%}" for name in CONDITIONS]
        spread = ", ".join(f"{value:.1f}" for value in one["limits"]["w_b"])
        limiting.append([f"`{robot}`", f"{counts['all']:,}", *shares, spread])
    return f"""# Where three and four limbs can walk

Made by `experiments/connectivity.py`: the JEM, collisions checked, explored from one random \
stance. Stances that were not reached may still be reachable.

![Base positions that were reached](connectivity.png)

{table(REACHED, reached)}
## What limits the robots

Neighbours of {SAMPLE} of these stances, by moves of limbs that can be released: the share that \
meets each condition and those before it. Manipulability is that of the posture with the largest \
margin, collisions ignored. The last column shows the ratio of base manipulability to its \
threshold `0.001 (2/N)^3` among neighbours whose limbs meet theirs: the 5th, 25th and 50th \
percentile.

{table(LIMITING, limiting)}"""


def picture(data: dict[str, Any], path: Path) -> None:
    """Plot base positions from the side and from above, in the colour of the face that is held."""
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
    """Explore and write the results."""
    parser = command_line(__doc__)
    parser.add_argument("--expansions", type=int, default=6000)
    args = parser.parse_args()
    data = {robot: explored(robot, args.expansions) for robot in ROBOTS}
    publish(args.out, "connectivity", data, markdown, indent=None)
    picture(data, args.out / "connectivity.png")


if __name__ == "__main__":
    main()
