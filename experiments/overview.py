"""Draw module, robot, stance graph, base path and footholds as in the paper's first figure.

    python experiments/overview.py [--out results]

Shows the walk of Case 3 in the cabin, the robot in its first and, pale, in its last stance, and the
base paths of a random sample of edges of the stance graph as thin lines. Writes `overview.png`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from reports import case_3, command_line

from mlivr_gym.arrays import Array
from mlivr_gym.pictures import Camera, Route, SceneRenderer, save_figure
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR
from mlivr_gym.pictures.scene_shapes import add_capsule, rgba
from mlivr_gym.robot import LIMB_COLOURS
from mlivr_gym.stances import StanceGraph
from mlivr_gym.world import BOX, scene_name

WIDTH, HEIGHT, DPI = 1600, 725, 100
"""Size of the scene [px] and resolution of the figure [px/inch]."""

EDGES = 1500
"""Number of edges of the stance graph that are drawn."""

CUT_OPEN = ("deck/forward/closeout", "overhead/forward/closeout")
"""Boxes that are not drawn, because the camera looks through them and the forward wall."""

EDGE_COLOUR, EDGE_RADIUS = "#6f8299", 0.0014
"""Colour and radius of their lines [m]."""


def edge_paths(graph: StanceGraph) -> Array:
    """Return the base positions at both ends of random edges, shape (e, 2, 3) [m]."""
    rng, found = np.random.default_rng(20261122), list[list[Array]]()
    while len(found) < EDGES:
        held, s = int(rng.integers(2)), int(rng.integers(len(graph)))
        steps = graph.successors(graph.state(graph.points[s].tolist()))
        others = steps.base_position[steps.limb == 1 - held]
        if len(others):
            found.append([graph.base_position[s], others[int(rng.integers(len(others)))]])
    return np.array(found)


def main() -> None:
    """Plan the walk and draw it."""
    path = command_line(__doc__).parse_args().out / "overview.png"
    graph, plan = case_3()
    renderer = SceneRenderer(graph.grasp_map, graph.robot, WIDTH, HEIGHT)
    for box in CUT_OPEN:
        renderer.model.geom(scene_name(BOX, box)).rgba[3] = 0.0
    edges, colour = edge_paths(graph), rgba(EDGE_COLOUR, 0.45)

    def draw_edges(scene: Any) -> None:
        for ends in edges:
            add_capsule(scene, ends, EDGE_RADIUS, colour)

    points = graph.grasp_map.positions
    x, y, z = (0.5 * (points.min(axis=0) + points.max(axis=0))).tolist()
    image = renderer.render(
        *plan.configuration(0),
        camera=Camera((x, y, z), distance=4.9, azimuth=98.0, elevation=-3.0),
        route=Route.of(graph.grasp_map, plan),
        ghosts=[plan.configuration(len(plan.steps))],
        draw=draw_edges,
    )
    renderer.close()
    head = 0.85
    figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI + head), dpi=DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, HEIGHT / (HEIGHT + head * DPI)))
    axes.imshow(image, aspect="auto")
    axes.axis("off")
    ball: dict[str, Any] = {"marker": "o", "ls": "none", "ms": 9}
    handles = [
        Line2D([], [], color=BASE_COLOUR, lw=4, marker="o", label="base path"),
        Line2D([], [], color=EDGE_COLOUR, lw=1,
               label=f"base paths of {EDGES} edges of the stance graph"),
        *(Line2D([], [], color=colour, label=f"footholds of limb {limb}", **ball)
          for limb, colour in enumerate(LIMB_COLOURS[: graph.limbs])),
        Line2D([], [], color=GOAL_COLOUR, label="goal", **ball),
    ]  # fmt: skip
    corner: dict[str, Any] = {"loc": "upper right", "bbox_to_anchor": (0.99, 0.995)}
    figure.legend(handles=handles, ncols=5, fontsize=10.5, frameon=False, **corner)
    figure.text(0.012, 0.963, "Walk of Case 3 through Kibo", fontsize=16, va="center")
    caption = (
        "numbers: after how many steps; the robot in its first stance and, pale, in its last; "
        "the forward wall is cut away"
    )
    figure.text(0.012, 0.918, caption, fontsize=10.5, va="center", color="0.25")
    path.parent.mkdir(parents=True, exist_ok=True)
    save_figure(figure, path, vector=False)


if __name__ == "__main__":
    main()
