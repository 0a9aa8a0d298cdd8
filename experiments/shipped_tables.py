"""The complete tables of two limbs that ship: the default world, and those of the paper's cases.

    python experiments/shipped_tables.py

Writes `envs_assets/pairs-*.npz`; tables of other rules, robots or maps there are removed. Takes
some minutes. `make slow` works the same out and compares.
"""

from __future__ import annotations

import os

from mlivr_gym import stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.paper import CASES, MODES, case_graph, default_setup
from mlivr_gym.stances.pair_build import fill_rows
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.pair_table_file import PAIR_TABLES


def shipped_graphs() -> dict[str, PairGraph]:
    """The graphs whose tables ship, by the name of their file, as they are worked out."""
    setup = default_setup()
    graphs = [stance_graph()]
    graphs += [case_graph(case, setup, mode) for mode in MODES for case in CASES]
    return {PAIR_TABLES.name(graph): graph for graph in graphs if isinstance(graph, PairGraph)}


def main() -> None:
    """Work them out and write them."""
    for old in asset_path("").glob("pairs-*.npz"):
        old.unlink()
    os.environ["MLIVR_GYM_CACHE"] = ""  # nothing is read from there
    for name, graph in shipped_graphs().items():
        fill_rows(graph)
        path = asset_path(name)
        PAIR_TABLES.write(graph, graph.kept(), path)
        print(f"{name}: {len(graph)} stances, {path.stat().st_size / 1e6:.2f} MB", flush=True)


if __name__ == "__main__":
    main()
