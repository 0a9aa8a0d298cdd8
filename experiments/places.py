"""Measure the places that ship.

    python experiments/places.py [--tasks 50] [--workers 2] [--out results]

For each place: the number of stances, a lower bound of its diameter, and the mean number of steps
of optimal plans for the fixed tasks of its environment. Writes `places.json` in some minutes;
`place_pictures.py` draws a plan in each place.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import gymnasium
import numpy as np
from reports import CORES, ROOT, experiment, study_rows, table

from mlivr_gym.envs import MlivrEnv
from mlivr_gym.errors import MapError
from mlivr_gym.files import read_json
from mlivr_gym.planners import Planner, SearchOptions
from mlivr_gym.planners.fewest_steps import fewest_steps
from mlivr_gym.planners.lower_bounds import MAX_STEPS
from mlivr_gym.stances import StanceGraph
from mlivr_gym.world import PLACES, as_map

ENVIRONMENTS = {
    "jem": "MLIVR-JEM-v0", "uslab": "MLIVR-USLab-v0", "columbus": "MLIVR-Columbus-v0",
    "hatch": "MLIVR-Hatch-v0", "station": "MLIVR-Station-v0", "truss": "MLIVR-Truss-v0",
}  # fmt: skip
"""Places and their environments."""

EXPANSIONS, INFLATION = 20_000, 1.2
"""Expansions after which a plan within a factor of the optimum is taken in place of an optimal one,
and that factor."""

SOURCES = {
    "jem": "NASA's mesh of the JEM, measured",
    "truss": "NASA's dimensions of S0, S1 and P1",
    "uslab": "NASA's mesh of the US Lab, measured; handrail poses of Chunting/r2_planning (BSD)",
    "columbus": "ESA's dimensions; racks as measured in the JEM",
    "hatch": "as `columbus`; NASA's dimensions of Node 2",
    "station": "as `hatch` and `jem`; NASA's dimensions of Destiny",
}
"""Where the figures of each map come from, in short; its file has the whole."""

SWEEPS = 8
"""Searches for the diameter, each from a stance farthest from the one before."""


def diameter(graph: StanceGraph) -> int:
    """Return a lower bound of the most moves between two connected stances, by repeated sweeps.

    A move is counted whether or not its step can be made, so that no plan is shorter.
    """
    n, longest, here = len(graph), 0, 0
    nothing, none = np.zeros(n, dtype=np.bool_), np.zeros(0, dtype=np.int64)
    for _ in range(SWEEPS):
        start = nothing.copy()
        start[here] = True
        moves, _ = fewest_steps(graph.table, start, nothing, none, MAX_STEPS)
        here = int(moves.argmax())
        longest = max(longest, int(moves[here]))
    return longest


@lru_cache(1)
def world_of(place: str) -> tuple[MlivrEnv, Planner]:
    """Return the environment of a place, and a planner in it."""
    made = gymnasium.make(f"mlivr_gym:{ENVIRONMENTS[place]}", disable_env_checker=True)
    env: Any = made.unwrapped
    return env, Planner(env.graph)


def planned(task: int, place: str) -> dict[str, Any]:
    """Return the number of steps of the plan for a task, and whether it is proved optimal."""
    env, planner = world_of(place)
    env.reset(options={"task": task})
    query: Any = {"cost": "steps", "goal_tolerance": env.goal_tolerance}
    found = planner.plan(env.state, env.goal, **query, options=SearchOptions(limit=EXPANSIONS))
    is_proved = found.plan is not None
    if not is_proved:
        found = planner.plan(
            env.state, env.goal, **query, options=SearchOptions(inflation=INFLATION)
        )
    return {"steps": len(found.unwrap().steps), "is_proved": is_proved}


def measured(place: str, tasks: int, workers: int) -> dict[str, Any]:
    """Return the figures of one place."""
    rows = study_rows("places:planned", tasks, workers, place=[place])
    steps, graph = [row["steps"] for row in rows], world_of(place)[0].graph
    low, high = as_map(place).cabin
    return {
        "size": (high - low).tolist(),
        "environment": ENVIRONMENTS[place],
        "points": len(graph.grasp_map),
        "stances": len(graph),
        "diameter": diameter(graph),
        "tasks": tasks,
        "unproved": sum(not row["is_proved"] for row in rows),
        "mean_steps": float(np.mean(steps)),
        "most_steps": max(steps),
    }


def all_measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return the figures of all places."""
    return {"places": {name: measured(name, tasks, workers) for name in ENVIRONMENTS}}


def markdown(data: dict[str, Any]) -> str:
    """Return the table of the places."""
    rows = []
    for name, row in data["places"].items():
        size = " x ".join(f"{edge:.1f}" for edge in row["size"])
        proof = (
            f", {row['unproved']} within {100 * (INFLATION - 1):.0f} %" if row["unproved"] else ""
        )
        rows.append(
            (
                f"`{row['environment']}`", f"`{name}`",
                row["points"], size, f"{row['stances']:,}", row["diameter"],
                f"{row['mean_steps']:.1f} (at most {row['most_steps']}{proof})",
            )
        )  # fmt: skip
    head = (
        "environment | map | points | size [m] | stances | diameter, moves at least | "
        "steps of optimal plans, mean"
    )
    return table(head, rows)


def maps() -> str:
    """Return the table of the maps that ship."""
    rows = []
    for name in PLACES:
        place = as_map(name)
        size = " x ".join(f"{edge:.1f}" for edge in place.cabin[1] - place.cabin[0])
        data = read_json(ROOT / "envs_assets" / f"{name}.json", "map", MapError)
        rows.append(
            (f"`{name}`", len(place), size, len(place.boxes), data["description"], SOURCES[name])
        )
    return table("name | points | where the base may be [m] | boxes | what it is | source", rows)


if __name__ == "__main__":
    experiment("places", __doc__, all_measured, tasks=50, workers=CORES)
