"""Draw a plan in each place that ships and in a random layout, on one sheet with scales.

    MUJOCO_GL=egl python experiments/place_pictures.py

Each picture has the robot in the first stance, pale in the others, and a bar whose length is right
at the distance of what the camera looks at. Writes `docs/pictures/places.png`.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from PIL import Image, ImageDraw
from places import INFLATION
from reports import ROOT, command_line

from mlivr_gym import stance_graph
from mlivr_gym.envs import MlivrEnv
from mlivr_gym.pictures import Camera, Route, SceneRenderer, save_image, with_caption
from mlivr_gym.pictures.camera import FIELD_OF_VIEW
from mlivr_gym.planners import Plan, Planner, SearchOptions
from mlivr_gym.stances import StanceGraph
from mlivr_gym.world import GraspMap, as_map

SIZE = 760, 400
"""Width and height of a picture without its caption [px]."""

PLANS = {
    "jem": (("D2a:4", "D2b:4"), (6.0, 0.0, 0.42)),
    "uslab": (("stow:0", "stow:1"), (2.17, -0.43, -0.35)),
    "columbus": (("D1a:2", "F1a:0"), (1.8, 0.2, 0.3)),
    "hatch": (("node/D1a:2", "node/F1a:0"), (1.6, 7.5, 0.2)),
    "station": (("columbus1/D1a:2", "columbus1/F1a:0"), (32.5, -5.0, 0.2)),
}
"""Start and goal in each place."""

ALONG = ("forward:1", "forward:3"), ("forward:8", "forward:10")
"""Stances at the start and at the goal on the truss."""

CAMERAS = {
    "jem": Camera((4.8, 0.0, 0.0), 8.0, 90.0, -12.0),
    "uslab": Camera((0.0, 0.0, -0.2), 6.2, 70.0, -22.0),
    "columbus": Camera((0.0, 0.0, 0.0), 5.8, 90.0, -12.0),
    "truss": Camera((0.0, 4.0, 0.0), 44.0, -90.0, -35.0),
    "hatch": Camera((0.5, 3.2, 0.0), 18.0, 90.0, -89.9),
    "station": Camera((15.7, -1.5, 0.0), 29.0, 90.0, -89.9),
    "random layout": Camera((4.8, 0.0, 0.0), 8.0, 90.0, -12.0),
}
"""Cameras, in the order of the sheet."""

HIDDEN = {
    "uslab": ("port", "overhead"),
    "truss": (),
    "hatch": ("overhead",),
    "station": ("overhead",),
}
"""Faces that are left out, since they would hide the plan; elsewhere `forward`."""

SEED = 5
"""Seed of the random layout and its task."""


def planned(name: str) -> tuple[StanceGraph, Plan]:
    """Return the graph and the plan of a place."""
    if name == "truss":
        env = environment("MLIVR-Truss-v0")
        goal = env.graph.configuration(env.graph.state(ALONG[1]))[0]
        found = Planner(env.graph).plan(ALONG[0], goal, "base", goal_tolerance=env.goal_tolerance)
        return env.graph, found.unwrap()
    start, goal = PLANS[name]
    graph = stance_graph(name)
    return graph, Planner(graph).plan(
        start, goal, "steps", options=SearchOptions(inflation=INFLATION)
    ).unwrap()


def environment(name: str) -> MlivrEnv:
    """Return an environment."""
    made: Any = gymnasium.make(f"mlivr_gym:{name}", disable_env_checker=True)
    env: MlivrEnv = made.unwrapped
    return env


def random_layout() -> tuple[StanceGraph, Plan, GraspMap]:
    """Return graph and plan in a random layout, and the map of its free points."""
    env = environment("MLIVR-Random-v0")
    env.reset(seed=SEED)
    plan = Planner(env.graph).plan(env.state, env.goal, "steps").unwrap()
    world = env.graph.grasp_map
    free = np.ones(len(world), dtype=np.bool_)
    free[list(env.graph.occupied)] = False
    return env.graph, plan, world.subset(free)


def with_scale(image: Any, distance: float) -> Any:
    """Return a picture with a bar, for what is at a distance from the camera [m]."""
    per_metre = 0.5 * image.shape[0] / np.tan(np.deg2rad(0.5 * FIELD_OF_VIEW)) / distance
    length = max(one for one in (1, 2, 5, 10, 20) if one * per_metre < 0.25 * image.shape[1])
    drawn = Image.fromarray(image)
    pen, y, width = ImageDraw.Draw(drawn), image.shape[0] - 16, length * per_metre
    pen.rectangle([8, y - 12, 90 + width, y + 12], fill="white")
    pen.line([(16, y), (16 + width, y)], fill="black", width=3)
    for x in (16, 16 + width):
        pen.line([(x, y - 5), (x, y + 5)], fill="black", width=3)
    pen.text((26 + width, y), f"{length} m", fill="black", anchor="lm", font_size=18)
    return np.asarray(drawn)


def shot(name: str) -> Any:
    """Return the picture of a place."""
    if name != "random layout":
        (graph, plan), world = planned(name), as_map(name)
    else:
        graph, plan, world = random_layout()
    camera = CAMERAS[name]
    renderer = SceneRenderer(world, graph.robot, *SIZE)
    image = renderer.render(
        *plan.configuration(0),
        hide=HIDDEN.get(name, ("forward",)),
        camera=camera,
        route=Route.of(graph.grasp_map, plan),
        ghosts=[plan.configuration(k) for k in range(1, len(plan.stances))],
    )
    renderer.close()
    caption = f"{name}: {len(world):,} points; {len(plan.steps)} steps, "
    caption += f"{plan.base_translation:.1f} m"
    return with_caption(with_scale(image, camera.distance), caption, SIZE[1])


def sheet() -> Any:
    """Return the pictures of all places, two in a row."""
    shots = [shot(name) for name in CAMERAS]
    if len(shots) % 2:
        shots.append(np.full_like(shots[0], 255))
    rows = [np.hstack(shots[k : k + 2]) for k in range(0, len(shots), 2)]
    return np.vstack(rows)


if __name__ == "__main__":
    command_line(__doc__, None).parse_args()
    save_image(sheet(), ROOT / "docs" / "pictures" / "places.png")
