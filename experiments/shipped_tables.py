"""Compute the tables of two limbs that ship: the default world and the paper's cases.

    python experiments/shipped_tables.py

Each table holds all nodes and edges of a stance graph of two limbs, with the branches that limbs
can keep. Writes `envs_assets/pairs-*.npz` in some minutes, and removes tables of other graph rules,
robots or maps from that folder. `make slow` computes the same tables and compares them. Those of
three and four limbs are written by `mlivr-gym build --robot mlivr3 --out envs_assets/NAME`.
"""

from __future__ import annotations

import os

from mlivr_gym import stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.paper import CASES, MODES, case_graph, default_setup
from mlivr_gym.stances.table_build import fill_rows, write_built
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.stances.two_limb_table_file import TWO_LIMB_TABLES


def shipped_graphs() -> dict[str, TwoLimbGraph]:
    """Return the stance graphs whose tables ship, by file name."""
    setup = default_setup()
    graphs = [stance_graph()]
    graphs += [case_graph(case, setup, mode) for mode in MODES for case in CASES]
    return {
        TWO_LIMB_TABLES.name(graph): graph for graph in graphs if isinstance(graph, TwoLimbGraph)
    }


def main() -> None:
    """Compute and write the tables."""
    for old in asset_path("").glob("pairs-*.npz"):
        old.unlink()
    os.environ["MLIVR_GYM_CACHE"] = ""  # no table is read from the cache
    for name, graph in shipped_graphs().items():
        fill_rows(graph)
        path = asset_path(name)
        write_built(graph, path)
        print(f"{name}: {len(graph)} stances, {path.stat().st_size / 1e6:.2f} MB", flush=True)


if __name__ == "__main__":
    main()
