"""Which rails or points cut a module in two when they are lost.

    python experiments/critical_parts.py [--out results]

For each place, each point and each rail with all its points is taken away in turn
(`stances.critical`), and in the JEM, whose steps are all checked, each pair of rails. Stances are
cut off if no walk joins them with most of the others any more. The fewest rails, or points, that
part one end of a module from the other are a minimum cut of the graph of rails, or points, two of
which are joined if a stance holds both (Menger 1927): with them gone, no stance leads across, and
fewer may do. Writes `critical_parts.json`, `critical_parts.md` and `critical_parts.png`, the points
of the JEM by the number of stances that hold them.
"""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from reports import experiment, table

from mlivr_gym import stance_graph
from mlivr_gym.arrays import BoolArray, IntArray
from mlivr_gym.pictures.figures import save_figure
from mlivr_gym.pictures.reach_figure import map_panels
from mlivr_gym.stances.critical import edges_of, parts_of, point_losses, rail_losses
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph

PLACES = ("jem", "uslab", "columbus", "hatch")
SHARE = 0.1
"""Least share of the stances that each of two parts of a module has."""

END = 0.15
"""Share of the length of a module that is one of its ends."""

SHOWN = 6
"""Number of rails or points that a list names."""


def rails_of(graph: TwoLimbGraph) -> tuple[list[str], IntArray]:
    """Return the ids of the rails, and the rail of each point, shape (m,)."""
    names = [point.rpartition(":")[0] for point in graph.grasp_map.ids]
    found, rail = np.unique(names, return_inverse=True)
    return found.tolist(), rail


def is_across(edges: IntArray, free: BoolArray, ends: tuple[BoolArray, BoolArray]) -> bool:
    """Return whether walks over some stances, shape (n,), lead from one end to the other."""
    part = parts_of(edges, free)
    first, last = (part[end & free] for end in ends)
    return bool(np.isin(first, last).any())


def ends_of(graph: TwoLimbGraph) -> tuple[BoolArray, BoolArray]:
    """Return which stances are at each end of the longest axis of a module, shape (n,)."""
    positions = graph.grasp_map.positions
    axis = int(np.ptp(positions, axis=0).argmax())
    low, high = positions[:, axis].min(), positions[:, axis].max()
    along = (positions[graph.points, axis] - low) / (high - low)
    return (along <= END).all(axis=1), (along >= 1.0 - END).all(axis=1)


def fewest_across(graph: TwoLimbGraph, owner: IntArray) -> IntArray:
    """Return the fewest owners of points, such as rails, that part the ends of a module.

    Each owner is an edge of capacity 1 from its entry to its exit; those at the ends stay.
    """
    count, large = int(owner.max()) + 1, 1000
    pairs = np.unique(owner[graph.points], axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    begin, end = (np.unique(owner[graph.points[one]]) for one in ends_of(graph))
    source, sink = 2 * count, 2 * count + 1
    inside = np.ones(count, dtype=np.int32)
    inside[begin] = inside[end] = large
    edges = [
        (np.arange(count), count + np.arange(count), inside),
        *((count + a, b, np.full(len(a), large)) for a, b in (pairs.T, pairs.T[::-1])),
        (np.full(len(begin), source), begin, np.full(len(begin), large)),
        (count + end, np.full(len(end), sink), np.full(len(end), large)),
    ]
    row, column, capacity = (np.concatenate(part) for part in zip(*edges, strict=True))
    size = 2 * count + 2
    flows = scipy.sparse.csr_array(
        (capacity.astype(np.int32), (row, column)), shape=(size, size), dtype=np.int32
    )
    flow = scipy.sparse.csgraph.maximum_flow(flows, source, sink)
    rest = flows - flow.flow
    rest.data[rest.data < 0] = 0
    rest.eliminate_zeros()
    reached = np.zeros(size, dtype=np.bool_)
    reached[scipy.sparse.csgraph.breadth_first_order(rest, source, return_predecessors=False)] = (
        True
    )
    return np.flatnonzero(reached[:count] & ~reached[count : 2 * count])


def losses_of(place: str) -> dict[str, Any]:
    """Return what is lost with each point and each rail of a place."""
    graph = stance_graph(place)
    assert isinstance(graph, TwoLimbGraph)
    names, rail = rails_of(graph)
    ids, edges = graph.grasp_map.ids, edges_of(graph)
    free = np.asarray((graph.branch_sets > 0).all(axis=1))
    ends, found = ends_of(graph), {"stances": int(free.sum()), "checked": graph.is_complete}
    for kind, losses in (("points", point_losses), ("rails", rail_losses)):
        lost = losses(graph)
        found[kind] = [one._asdict() | {"points": None} for one in lost if one.is_critical]
        found[f"{kind}_tried"] = len(lost)
    for kind, labels, owner in (("rails", names, rail), ("points", ids, np.arange(len(ids)))):
        cut = fewest_across(graph, owner)
        rest = free & ~np.isin(owner[graph.points], cut).any(axis=1)
        assert is_across(edges, free, ends)
        assert not is_across(edges, rest, ends)
        found[f"fewest_{kind}"] = [labels[k] for k in cut.tolist()]
    if graph.is_complete:
        pairs = list(combinations(range(len(names)), 2))
        held = [(rail[graph.points] == k).any(axis=1) for k in range(len(names))]
        cut_pairs = [
            [names[a], names[b]] for a, b in pairs if cuts_in_two(edges, free & ~held[a] & ~held[b])
        ]
        found |= {"pairs": len(pairs), "cutting_pairs": cut_pairs}
    if place == "jem":
        counts = np.bincount(graph.points[free].ravel(), minlength=len(ids))
        found["held_by"] = counts.tolist()
    return found


def cuts_in_two(edges: IntArray, kept: BoolArray) -> bool:
    """Return whether the stances that are kept, shape (n,), have two parts of a size."""
    sizes = np.sort(np.bincount(parts_of(edges, kept)[kept]))
    return len(sizes) > 1 and bool(sizes[-2] >= SHARE * kept.sum())


def measured() -> dict[str, Any]:
    """Return the losses of all places."""
    return {place: losses_of(place) for place in PLACES}


def listed(losses: list[dict[str, Any]]) -> str:
    """Return critical points or rails in words."""
    if not losses:
        return "none"
    more = f", and {len(losses) - SHOWN} more" if len(losses) > SHOWN else ""
    return ", ".join(f"{one['id']} ({one['cut_off']})" for one in losses[:SHOWN]) + more


def markdown(data: dict[str, Any]) -> str:
    """Return the page."""
    rows = [
        (
            f"`{place}`", f"{found['stances']:,}", listed(found["points"]), listed(found["rails"]),
            len(found["fewest_rails"]), len(found["fewest_points"]),
        )
        for place, found in data.items()
    ]  # fmt: skip
    head = (
        "place | stances | points whose loss cuts stances off (how many) | rails | "
        "rails that part the ends | points that part them"
    )
    jem = data["jem"]
    pairs = len(jem["cutting_pairs"]) or "none"
    worst = max(one["cut_off"] for one in jem["points"] + jem["rails"])
    return f"""# What cuts a module in two

Made by `experiments/critical_parts.py` for two limbs. Each point and each rail is taken away in \
turn. A loss cuts a module in two if two parts with at least {100 * SHARE:.0f} % of its stances \
each remain.

{table(head, rows)}
**In the JEM** no point and no rail does: the worst cuts off {worst} of {jem["stances"]:,} \
stances. Of all {jem["pairs"]:,} pairs of rails {pairs} cuts it in two. All steps are checked \
there; elsewhere a step that has not been checked counts as possible, so that more may be cut off.

The last two columns are minimum cuts: with that many rails, or points, gone, no walk leads from \
one end of the module to the other. Fewer may do, since not every step between stances is \
possible. In the JEM these rails are {", ".join(jem["fewest_rails"])}.

![Points of the JEM by the number of stances that hold them](critical_parts.png)

Dots are the points by the number of stances that hold them; red rings mark the points whose loss \
cuts stances off, and squares the rails of the minimum cut. From one start, `mlivr-gym reach \
--picture` draws after how many steps each point is held.
"""


def picture(data: dict[str, Any], path: Path) -> None:
    """Draw the points of the JEM by the stances that hold them."""
    grasp_map, jem = stance_graph().grasp_map, data["jem"]
    critical = {one["id"] for one in jem["points"]}
    cut, counts = set(jem["fewest_rails"]), np.array(jem["held_by"])
    figure, panels = map_panels(grasp_map)
    for axes, points, flat in panels:
        ids = [grasp_map.ids[p] for p in points]
        shown = axes.scatter(
            *flat.T, c=counts[points], s=22, cmap="viridis_r", vmin=0, vmax=counts.max(), zorder=2
        )
        for chosen, marker, colour, size in (
            ([p.rpartition(":")[0] in cut for p in ids], "s", "0.3", 60),
            ([p in critical for p in ids], "o", "#d00000", 110),
        ):
            some = flat[np.array(chosen)]
            axes.scatter(*some.T, s=size, marker=marker, facecolor="none", edgecolor=colour)
    figure.set_size_inches(12.8, 1.3 * len(panels))
    figure.tight_layout(rect=(0.0, 0.0, 0.92, 1.0))
    bar = figure.add_axes((0.93, 0.2, 0.012, 0.6))
    figure.colorbar(shown, cax=bar, label="stances that hold the point")
    save_figure(figure, path)


if __name__ == "__main__":
    experiment("critical_parts", __doc__, measured, markdown, picture)
