"""Compute the tables of two limbs that ship: those of the default world and of Table I.

    python experiments/shipped_tables.py

Each table holds all nodes and edges of a stance graph of two limbs, with the branches that limbs
can keep. Writes `envs_assets/table-*.npz` and removes tables of other graph rules, robots or maps
from that folder. `make slow` computes the same tables and compares them. Those of three and four
limbs are written by `mlivr-gym build --robot mlivr3 --out envs_assets/NAME`.
"""

from __future__ import annotations

import os

from reports import command_line

from mlivr_gym import Settings, stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.stances import build_table, write_built
from mlivr_gym.stances.table_file import TABLES

SHIPPED = (
    Settings(),
    Settings(collisions=False),
    Settings(manipulability=False, collisions=False),
)
"""Settings of the worlds whose tables ship; without the last one, Case 1 with steps checked takes
minutes."""


def main() -> None:
    """Compute and write the tables."""
    command_line(__doc__, None).parse_args()
    os.environ["MLIVR_GYM_CACHE"] = ""  # no table is read from the cache
    kept = {TABLES.name(stance_graph(robot=f"mlivr{limbs}")) for limbs in (3, 4)}
    for old in asset_path("").glob("table-*.npz"):
        if old.name not in kept:
            old.unlink()
    for settings in SHIPPED:
        graph = stance_graph(settings=settings)
        path = asset_path(TABLES.name(graph))
        build_table(graph)
        write_built(graph, path)
        print(f"{path.name}: {len(graph)} stances, {path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
