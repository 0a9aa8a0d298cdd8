"""The panel of the page: its items, and the methods of the viewer that they call."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mlivr_gym.motion.plan_parts import COSTS
from mlivr_gym.planners.costs import HIGHEST_PRICE
from mlivr_gym.viewer import drawing
from mlivr_gym.viewer.live_plan import PRICE
from mlivr_gym.viewer.viewer import AIM, BLOCK, EXPLAIN, Viewer

SPEEDS = ("0.25x", "0.5x", "1x", "2x", "5x", "10x", "20x")
"""Speeds to choose from, relative to the time of the frames."""

BACK, PLAY, ON = "◀ step", "play", "step ▶"
"""Buttons below the scrubber; the middle one also pauses."""


def add_panel(viewer: Viewer) -> None:
    """Add the items of the panel, and connect the page with the viewer's methods."""
    page = viewer.page
    page.text("summary")
    with page.gui.add_folder("Play"):
        _add_playing(viewer)
    with page.gui.add_folder("Change"):
        _add_changing(viewer)
    with page.gui.add_folder("Show"):
        reach = page.gui.add_checkbox("points within reach", False)
        page.item("reach", reach, viewer.show_reach)
        page.text("legend")
    for face, points in drawing.points_by_face(viewer.live.graph.grasp_map).items():
        page.nodes[f"points/{face}"].on_click(
            lambda event, points=points: viewer.clicked(int(points[event.instance_index]))
        )
    page.gizmo(AIM, viewer.live.goal, lambda at: viewer.change(lambda: viewer.live.set_goal(at)))
    page.server.on_client_connect(
        lambda client: client.camera.on_update(
            lambda camera: viewer.hide_walls_from(np.array(camera.position))
        )
    )
    viewer.refresh()


def _add_playing(viewer: Viewer) -> None:
    """Add scrubber, buttons and speed."""
    page, gui = viewer.page, viewer.page.gui
    page.item("time", gui.add_slider("time [s]", 0.0, 0.1, 0.01, 0.0), viewer.scrub)
    actions: dict[str, Callable[[], None]] = {
        BACK: lambda: viewer.jump(-1),
        PLAY: viewer.toggle,
        ON: lambda: viewer.jump(1),
    }
    buttons = gui.add_button_group("", tuple(actions))
    buttons.on_click(lambda event: actions[str(event.target.value)]())
    speed = gui.add_dropdown("speed", SPEEDS, initial_value=f"{viewer.speed:g}x")
    page.item("speed", speed, lambda chosen: setattr(viewer, "speed", float(chosen[:-1])))


def _add_changing(viewer: Viewer) -> None:
    """Add the items that change query and obstacles."""
    page, gui, live = viewer.page, viewer.page.gui, viewer.live
    starts = [f"start of limb {limb}" for limb in range(live.graph.limbs)]
    clicks = gui.add_dropdown(
        "a click on a point", (EXPLAIN, BLOCK, *starts), initial_value=viewer.click
    )
    page.item("click", clicks, lambda chosen: setattr(viewer, "click", chosen))
    page.text("explanation")
    cost = gui.add_dropdown("cost", COSTS, initial_value=live.query["cost"])
    first_price = live.query.get("regrasp_price") or PRICE
    price = gui.add_number("regrasp price [m]", first_price, min=0.0, max=HIGHEST_PRICE, step=0.01)

    def set_cost(_: object) -> None:
        price.disabled = cost.value != "weighted"
        viewer.change(lambda: live.set_cost(cost.value, price.value))

    page.item("cost", cost, set_cost)
    page.item("price", price, set_cost)
    price.disabled = cost.value != "weighted"
    hint = "adds a box on the base path; drag it by its arrows"
    gui.add_button("Add a box", hint=hint).on_click(lambda _: viewer.add_box())
    gui.add_button("Remove boxes, free all points").on_click(lambda _: viewer.clear())
