"""The overview, like the paper's first figure: module, robot, stance graph, base path, footholds.

    python experiments/overview.py [--out results]

writes `overview.png`: the walk of Case 3 in the cabin, the robot in its first and its last stance,
and base paths of a sample of the stance graph's edges as thin lines.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array
from mlivr_gym.motion.plan_motion import step_motion
from mlivr_gym.paper import CASES, case_graph, default_setup
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR, save_figure
from mlivr_gym.pictures.studio import aim, studio_spec
from mlivr_gym.planners import Plan, Planner
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.simulation.scene import FACE_GROUPS, compiled, rgba, set_configuration
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.world.boxes import BOX, scene_name

WIDTH, HEIGHT, DPI = 1600, 725, 100
"""Size of the scene in the picture [pixels], and their number in an inch."""

HEAD = 0.85
"""Height of the heading [inches]."""

EDGES = 1500
"""Edges of the stance graph that are drawn."""

CLOSE = 28.0
"""Labels of points closer to each other would overlap [pixels]."""

SEED = 20261122
HIDDEN = ("forward",)
"""Cabin faces that are not drawn, since the camera looks through them."""

CUT_OPEN = ("deck/forward/closeout", "overhead/forward/closeout")
"""Boxes that are not drawn for the same reason."""

CAMERA = {"distance": 4.9, "azimuth": 98.0, "elevation": -3.0}
EDGE_COLOUR = "#6f8299"


def edge_paths(graph: PairGraph) -> Array:
    """Base positions at both ends of some edges of the stance graph, shape (e, 2, 3) [m]."""
    rng, found = np.random.default_rng(SEED), []
    while len(found) < EDGES:
        held, s = int(rng.integers(2)), int(rng.integers(len(graph)))
        row = graph.row(held, s)
        others = row[np.asarray(graph.edge_masks(held, s, row)) > 0]
        others = others[others != s]
        if len(others):
            t = int(rng.choice(others))
            found.append([graph.base_in_world[s], graph.base_in_world[t]])
    return np.array(found)


class Drawing:
    """The scene with lines and balls added to it."""

    def __init__(self, graph: PairGraph) -> None:
        """Compile the scene and open a GL context."""
        self.model = compiled(studio_spec(graph.grasp_map, graph.robot))
        self.model.vis.quality.offsamples = 16
        self.model.vis.global_.offwidth, self.model.vis.global_.offheight = WIDTH, HEIGHT
        self.data = mujoco.MjData(self.model)
        self.renderer = mujoco.Renderer(self.model, HEIGHT, WIDTH, max_geom=20_000)
        self.options = mujoco.MjvOption()
        self.options.geomgroup[:], self.options.sitegroup[:] = 1, 1
        for face in HIDDEN:
            self.options.geomgroup[FACE_GROUPS[face]] = 0
            self.options.sitegroup[FACE_GROUPS[face]] = 0
        self.camera = mujoco.MjvCamera()
        points = graph.grasp_map.positions
        self.camera.lookat[:] = 0.5 * (points.min(axis=0) + points.max(axis=0))
        for name, value in CAMERA.items():
            setattr(self.camera, name, value)
        aim(self.model, graph.grasp_map, Camera(tuple(self.camera.lookat), **CAMERA))
        for box in CUT_OPEN:
            self.model.geom(scene_name(BOX, box)).rgba[3] = 0.0

    def place(self, plan: Plan, k: int) -> None:
        """Begin with the robot in stance `k`."""
        set_configuration(self.model, self.data, *plan.configuration(k))
        self.renderer.update_scene(self.data, self.camera, self.options)

    def add_robot(self, plan: Plan, k: int) -> None:
        """Draw the robot in stance `k` too."""
        other = mujoco.MjData(self.model)
        set_configuration(self.model, other, *plan.configuration(k))
        perturbation, kinds = mujoco.MjvPerturb(), int(mujoco.mjtCatBit.mjCAT_DYNAMIC)
        mujoco.mjv_addGeoms(
            self.model, other, self.options, perturbation, kinds, self.renderer.scene
        )

    def _geom(self) -> Any:
        scene = self.renderer.scene
        scene.ngeom += 1
        return scene.geoms[scene.ngeom - 1]

    def _without_shadow(self) -> None:
        """Let what was added last cast none: hundreds of thin lines would darken the walls."""
        scene = self.renderer.scene
        scene.geoms[scene.ngeom - 1].category = mujoco.mjtCatBit.mjCAT_DECOR

    def ball(self, centre: Array, radius: float, colour: str, opacity: float = 1.0) -> None:
        """Add a ball."""
        tint = np.array([*rgba(colour)[:3], opacity], dtype=np.float32)
        mujoco.mjv_initGeom(
            self._geom(), mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, radius), centre,
            np.eye(3).ravel(), tint,
        )  # fmt: skip
        self._without_shadow()

    def line(self, ends: Array, width: float, colour: str, opacity: float = 1.0) -> None:
        """Add a rod of a radius [m] between two points, shape (2, 3) [m]."""
        geom, tint = self._geom(), np.array([*rgba(colour)[:3], opacity], dtype=np.float32)
        kind = mujoco.mjtGeom.mjGEOM_CAPSULE
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), tint)
        mujoco.mjv_connector(geom, kind, width, ends[0], ends[1])
        self._without_shadow()

    def image(self) -> NDArray[np.uint8]:
        """The picture, shape (height, width, 3)."""
        picture: NDArray[np.uint8] = self.renderer.render()
        return picture

    def seen(self, point: Array) -> tuple[float, float]:
        """Where a point is in the picture, in pixels from the upper left corner."""
        eye = self.renderer.scene.camera[0]
        other = self.renderer.scene.camera[1]
        middle = 0.5 * (np.array(eye.pos) + np.array(other.pos))
        forward, up = np.array(eye.forward), np.array(eye.up)
        right, to = np.cross(forward, up), point - middle
        scale = 0.5 * HEIGHT / np.tan(0.5 * np.deg2rad(self.model.vis.global_.fovy))
        depth = float(to @ forward)
        x, y = float(to @ right) / depth, float(to @ up) / depth
        return 0.5 * WIDTH + scale * x, 0.5 * HEIGHT - scale * y


def draw(graph: PairGraph, plan: Plan) -> Drawing:
    """The scene with everything in it."""
    drawing = Drawing(graph)
    drawing.place(plan, 0)
    drawing.add_robot(plan, len(plan.steps))
    for ends in edge_paths(graph):
        drawing.line(ends, 0.0014, EDGE_COLOUR, 0.45)
    for k in range(len(plan.steps)):
        base = step_motion(graph, plan, k, 20).base_positions
        for ends in np.stack([base[:-1], base[1:]], axis=1):
            if np.linalg.norm(ends[1] - ends[0]) > 1e-6:
                drawing.line(ends, 0.016, BASE_COLOUR)
    for position in plan.motion.base_positions:
        drawing.ball(position, 0.034, BASE_COLOUR)
    for limb, points in enumerate(plan.footholds):
        for point in points:
            drawing.ball(graph.grasp_map.positions[graph.grasp_map.index(point)], 0.04,
                         LIMB_COLOURS[limb])  # fmt: skip
    drawing.ball(np.array(plan.query.goal), plan.query.goal_tolerance, GOAL_COLOUR, 0.25)
    return drawing


def label(axes: Any, drawing: Drawing, point: Array, text: str, colour: str) -> None:
    """Write beside a point of the scene; below it where something stands beside it already."""
    from matplotlib.patheffects import withStroke

    place = np.array(drawing.seen(point))
    close = any(np.linalg.norm(place - other.xy) < CLOSE for other in axes.texts)
    axes.annotate(
        text, place, (7, -15 if close else 8), textcoords="offset points", color=colour,
        fontsize=12, weight="bold", path_effects=[withStroke(linewidth=3.0, foreground="white")],
    )  # fmt: skip


def overview(graph: PairGraph, plan: Plan, path: Path) -> None:
    """Draw the picture with its labels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    drawing = draw(graph, plan)
    figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI + HEAD), dpi=DPI)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, HEIGHT / (HEIGHT + HEAD * DPI)))
    axes.imshow(drawing.image(), aspect="auto")
    axes.axis("off")
    for k, position in enumerate(plan.motion.base_positions):
        label(axes, drawing, position, str(k), BASE_COLOUR)
    for limb, points in enumerate(plan.footholds):
        steps = [0, *(k + 1 for k, step in enumerate(plan.steps) if step.limb == limb)]
        for k, point in zip(steps, points, strict=True):
            position = graph.grasp_map.positions[graph.grasp_map.index(point)]
            label(axes, drawing, position, str(k), LIMB_COLOURS[limb])
    handles: list[Any] = [
        Line2D([], [], color=BASE_COLOUR, linewidth=4, marker="o", label="base path"),
        Line2D([], [], color=EDGE_COLOUR, linewidth=1,
               label=f"base paths of {EDGES} edges of the stance graph"),
        *(
            Line2D([], [], color=colour, marker="o", linestyle="none", markersize=9,
                   label=f"footholds of limb {limb}")
            for limb, colour in enumerate(LIMB_COLOURS[: graph.limbs])
        ),
        Line2D([], [], color=GOAL_COLOUR, marker="o", linestyle="none", markersize=11,
               label="goal"),
    ]  # fmt: skip
    figure.legend(
        handles=handles, loc="upper right", bbox_to_anchor=(0.99, 0.995), ncols=5, fontsize=10.5,
        frameon=False,
    )  # fmt: skip
    figure.text(0.012, 0.963, "Walk of Case 3 through Kibo", fontsize=16, va="center")
    cut = {point for points in plan.footholds for point in points} & {
        point
        for point, face in zip(graph.grasp_map.ids, graph.grasp_map.faces, strict=True)
        if face in HIDDEN
    }
    told = (
        "numbers: after how many steps; the robot in its first and its last stance; "
        f"the {' and '.join(HIDDEN)} wall is cut away"
        + (f", foothold {' '.join(sorted(cut))} lies on it" if cut else "")
    )
    figure.text(0.012, 0.918, told, fontsize=10.5, va="center", color="0.25")
    save_figure(figure, path)


def main() -> None:
    """Plan the walk and draw it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("results"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    setup = default_setup()
    graph = case_graph(3, setup, "collisions")
    planned = Planner(graph).plan(
        setup["start"], setup["goal"], CASES[3].cost, goal_face=setup["goal_face"]
    )
    overview(graph, planned.unwrap(), args.out / "overview.png")


if __name__ == "__main__":
    main()
