"""Compute the tables of two limbs that ship: those of the default world and of Table I.

    python experiments/shipped_tables.py [--workers 2]

Each table holds all nodes and edges of a stance graph of two limbs, with the branches that limbs
can keep. Writes `envs_assets/table-*.npz` and removes tables of other graph rules, robots or maps
from that folder. `make slow` computes the same tables and compares them. Those of three and four
limbs are written by `mlivr-gym build --robot mlivr3 --out envs_assets/NAME`.
"""

from __future__ import annotations

import os
from typing import Any

from reports import CORES, command_line, study_rows

from mlivr_gym import Settings, stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.stances import StanceGraph, build_table, write_built
from mlivr_gym.stances.table_file import TABLES

SHIPPED = (
    Settings(),
    Settings(collisions=False),
    Settings(manipulability=False, collisions=False),
)
"""Settings of the worlds whose tables ship; without the last one, Case 1 with steps checked takes
minutes."""


def made(task: int) -> StanceGraph:
    """Return the stance graph of one of the tables that ship."""
    return stance_graph(settings=SHIPPED[task])


def built(task: int) -> dict[str, Any]:
    """Compute and write one of the tables anew."""
    os.environ["MLIVR_GYM_CACHE"] = ""  # no table is read from the cache
    path = asset_path(TABLES.name(made(task)))
    path.unlink(missing_ok=True)
    graph = made(task)
    build_table(graph)
    write_built(graph, path)
    return {"name": path.name, "stances": len(graph), "size": path.stat().st_size}


def main() -> None:
    """Compute and write the tables."""
    workers = command_line(__doc__, None, workers=CORES).parse_args().workers
    rows = study_rows("shipped_tables:built", len(SHIPPED), workers)
    others = {TABLES.name(stance_graph(robot=f"mlivr{limbs}")) for limbs in (3, 4)}
    for old in asset_path("").glob("table-*.npz"):
        if old.name not in {row["name"] for row in rows} | others:
            old.unlink()
    for row in rows:
        print(f"{row['name']}: {row['stances']} stances, {row['size'] / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
