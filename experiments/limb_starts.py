"""Count how often robots with two to eight limbs can hold a random stance and leave it.

    python experiments/limb_starts.py [--out results] [--workers 2]

For each number of limbs, a robot with the default body draws 200 random stances on the JEM as
`random_state` does, with collisions checked. Counted are the draws that are nodes, and the nodes
that at least one step leaves. Writes `limb_starts.json`; `readme.py` shows the table in the docs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from reports import CORES, experiment, study_rows, table

from mlivr_gym import RobotSpec, stance_graph
from mlivr_gym.robot.specification import MOST_LIMBS
from mlivr_gym.stances.random_states import TRIES, random_stance


def starts(task: int, limbs: int) -> dict[str, int]:
    """Return how many of `TRIES` random draws are nodes, and how many of those a step leaves."""
    graph = stance_graph(robot=RobotSpec(name=f"limbs{limbs}", limbs=limbs))
    rng = np.random.default_rng(0)
    drawn = [random_stance(graph, rng) for _ in range(TRIES)]
    held = [state for state in drawn if state is not None]
    return {"held": len(held), "left": sum(bool(graph.successors(state)) for state in held)}


def measured(workers: int) -> dict[str, Any]:
    """Return the counts for each number of limbs."""
    rows = study_rows("limb_starts:starts", 1, workers, limbs=range(2, MOST_LIMBS + 1))
    return {str(row["limbs"]): {name: row[name] for name in ("held", "left")} for row in rows}


def markdown(data: dict[str, Any]) -> str:
    """Return the table for the page on robots."""
    head = f"limbs | stances held in {TRIES} draws | of which a step leaves"
    return table(head, [(limbs, row["held"], row["left"]) for limbs, row in data.items()])


if __name__ == "__main__":
    experiment("limb_starts", __doc__, measured, workers=CORES)
