"""How often a random stance of robots with two to eight limbs can be held, and whether it is left.

    python experiments/limb_starts.py

Robots with the default body on the JEM, collisions checked; 200 draws each, as `random_state` makes
them. Writes `results/limb_starts.json`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from reports import command_line, keep, table

from mlivr_gym import RobotSpec, stance_graph
from mlivr_gym.robot.specification import MOST_LIMBS
from mlivr_gym.stances.random_states import TRIES, random_stance


def starts(limbs: int) -> dict[str, int]:
    """Stances found in `TRIES` draws, and how many of them a step leaves."""
    graph = stance_graph(robot=RobotSpec(name=f"limbs{limbs}", limbs=limbs))
    rng = np.random.default_rng(0)
    drawn = [random_stance(graph, rng) for _ in range(TRIES)]
    held = [state for state in drawn if state is not None]
    return {"held": len(held), "left": sum(bool(graph.successors(state)) for state in held)}


def told(data: dict[str, Any]) -> str:
    """A table for the page on robots."""
    head = f"limbs | stances held in {TRIES} draws | of which a step leaves"
    return table(head, [(limbs, row["held"], row["left"]) for limbs, row in data.items()])


def main() -> None:
    """Count and write."""
    out = command_line(__doc__).parse_args().out
    data = {str(limbs): starts(limbs) for limbs in range(2, MOST_LIMBS + 1)}
    keep(out, "limb_starts", data)
    print(told(data))


if __name__ == "__main__":
    main()
