"""Measure the places that ship, and draw a plan in those that are made of modules.

    python experiments/places.py [--tasks 50] [--workers 2] [--out results]

For each place: the number of stances, a lower bound of its diameter, and the mean number of steps
of optimal plans for the fixed tasks of its environment. Writes `places.json` and the pictures
`docs/pictures/columbus.png`, `hatch.png` and `station.png`; takes some minutes.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import gymnasium
import numpy as np
from reports import CORES, ROOT, experiment, study_rows, table, two_limb_graph

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.figures import save_image
from mlivr_gym.pictures.rendering import SceneRenderer
from mlivr_gym.pictures.route import Route
from mlivr_gym.planners import Planner
from mlivr_gym.planners.fewest_steps import fewest_steps
from mlivr_gym.planners.lower_bounds import MAX_STEPS
from mlivr_gym.stances.two_limb_graph import TwoLimbGraph
from mlivr_gym.world.grasp_map import as_map

ENVIRONMENTS = {
    "jem": "MLIVR-JEM-v0", "uslab": "MLIVR-USLab-v0", "columbus": "MLIVR-Columbus-v0",
    "hatch": "MLIVR-Hatch-v0", "station": "MLIVR-Station-v0", "truss": "MLIVR-Truss-v0",
}  # fmt: skip
"""Places and their environments."""

EXPANSIONS, INFLATION = 20_000, 1.2
"""Expansions after which a plan within a factor of the optimum is taken in place of an optimal one,
and that factor."""

SWEEPS = 8
"""Searches for the diameter, each from a stance farthest from the one before."""

QUERIES = {
    "columbus": (("D1a:2", "F1a:0"), (1.8, 0.2, 0.3)),
    "hatch": (("node/D1a:2", "node/F1a:0"), (1.6, 7.5, 0.2)),
    "station": (("columbus1/D1a:2", "columbus1/F1a:0"), (32.5, -5.0, 0.2)),
}
"""Start and goal of the plans that are drawn."""

CAMERAS = {"columbus": None, "hatch": (0.5, 4.0, 15.5), "station": (15.7, -1.5, 29.0)}
"""Place that the camera looks down to, x and y, and its distance [m]; None: into the cabin."""

SIZE = 1280, 640
"""Size of the pictures [px]."""


def diameter(graph: TwoLimbGraph) -> int:
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
    found = planner.plan(env.state, env.goal, **query, limit=EXPANSIONS)
    is_proved = found.plan is not None
    if not is_proved:
        found = planner.plan(env.state, env.goal, **query, inflation=INFLATION)
    return {"steps": len(found.unwrap().steps), "is_proved": is_proved}


def measured(place: str, tasks: int, workers: int) -> dict[str, Any]:
    """Return the figures of one place."""
    rows = study_rows("places:planned", tasks, workers, place=[place])
    steps, graph = [row["steps"] for row in rows], world_of(place)[0].graph
    assert isinstance(graph, TwoLimbGraph)
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


def draw(name: str) -> dict[str, Any]:
    """Draw a plan of a place; return its figures."""
    graph = two_limb_graph(as_map(name))
    start, goal = QUERIES[name]
    plan = Planner(graph).plan(start, goal, "steps", inflation=INFLATION).unwrap()
    renderer, where = SceneRenderer(graph.grasp_map, graph.robot, *SIZE), CAMERAS[name]
    view: dict[str, Any] = {}
    if where is not None:
        x, y, far = where
        view = {"camera": Camera((x, y, 0.0), far, 90.0, -89.9), "hide": ("overhead",)}
    ghosts = [plan.configuration(k) for k in range(1, len(plan.stances))]
    picture = renderer.render(
        *plan.configuration(0), route=Route.of(graph.grasp_map, plan), ghosts=ghosts, **view
    )
    renderer.close()
    save_image(picture, ROOT / "docs" / "pictures" / f"{name}.png")
    return {"steps": len(plan.steps), "base_translation_m": plan.base_translation}


def all_measured(tasks: int, workers: int) -> dict[str, Any]:
    """Return the figures of all places and of the plans that are drawn."""
    places = {name: measured(name, tasks, workers) for name in ENVIRONMENTS}
    return {"places": places, "plans": {name: draw(name) for name in QUERIES}}


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


if __name__ == "__main__":
    experiment("places", __doc__, all_measured, tasks=50, workers=CORES)
