"""The panel of the page: what it holds, and whom each part calls."""

from __future__ import annotations

import numpy as np

from mlivr_gym.errors import missing
from mlivr_gym.motion.plan_parts import COSTS
from mlivr_gym.planners.costs import HIGHEST_PRICE
from mlivr_gym.viewer import drawing
from mlivr_gym.viewer.live_plan import PRICE
from mlivr_gym.viewer.policy_view import NEEDED
from mlivr_gym.viewer.second_plan import APART, HIDDEN, OVER
from mlivr_gym.viewer.viewer import (
    AIM,
    BLOCK,
    PLAIN,
    PLOTS,
    POLICY,
    REACH,
    TELL,
    WHY,
    Viewer,
)

SPEEDS = ("0.25x", "0.5x", "1x", "2x", "5x", "10x", "20x")
"""Speeds to choose from, times as fast as the clock of what is played."""

BACK, PLAY, ON = "◀ step", "play", "step ▶"
"""Buttons below the scrubber; the middle one pauses, too."""


def add_panel(viewer: Viewer) -> None:
    """Fill the panel of a viewer's page, and let the page call the viewer."""
    page = viewer.page
    page.text("summary")
    with page.folder("Play"):
        _add_playing(viewer)
    with page.folder("Change"):
        _add_changing(viewer)
    with page.folder("Show"):
        _add_showing(viewer)
    if viewer.second is not None:
        with page.folder("Second plan"):
            page.choice("second", "shown", (OVER, APART, HIDDEN), OVER, viewer.place_second)
    for face in drawing.points_by_face(viewer.live.graph.grasp_map):
        page.on_click(f"points/{face}", viewer.clicked)
    goal = np.array(viewer.live.asked.goal)
    page.gizmo(AIM, goal, lambda at: viewer.change(lambda: viewer.live.aim(at)))
    page.on_camera(viewer.see_from)


def _add_playing(viewer: Viewer) -> None:
    page = viewer.page
    page.text("where")
    page.slider("time", "time [s]", max(viewer.duration, 0.1), 0.01, viewer.scrub)
    page.buttons("play", (BACK, PLAY, ON), lambda label: _press(viewer, label))
    page.choice("speed", "speed", SPEEDS, f"{viewer.speed:g}x", lambda chosen: _run(viewer, chosen))
    for name in PLOTS:
        page.plot(name)


def _press(viewer: Viewer, label: str) -> None:
    if label == PLAY:
        viewer.toggle()
    else:
        viewer.jump(1 if label == ON else -1)


def _run(viewer: Viewer, chosen: str) -> None:
    viewer.speed = float(chosen.removesuffix("x"))


def _add_changing(viewer: Viewer) -> None:
    page, live = viewer.page, viewer.live
    cost = {"name": live.asked.cost, "price": live.asked.regrasp_price or PRICE}

    def charge(**changed: object) -> None:
        cost.update(changed)
        name, price = str(cost["name"]), float(str(cost["price"]))
        page.enable("price", name == "weighted")
        viewer.change(lambda: live.charge(name, price))

    starts = [f"start of limb {limb}" for limb in range(live.graph.limbs)]
    page.choice("click", "a click on a point", (TELL, BLOCK, *starts), viewer.click, viewer.choose)
    page.text("told")
    page.choice("cost", "cost", COSTS, live.asked.cost, lambda name: charge(name=name))
    page.number(
        "price", "regrasp price [m]", float(str(cost["price"])), HIGHEST_PRICE,
        lambda price: charge(price=price),
    )  # fmt: skip
    page.enable("price", live.asked.cost == "weighted")
    page.button("box", "Add a box", viewer.add_box, "put on the base path; drag it by its arrows")
    page.button("clear", "Remove boxes, free all points", viewer.clear)


def _add_showing(viewer: Viewer) -> None:
    page, graph = viewer.page, viewer.live.graph
    whys = [f"{WHY}{limb}" for limb in range(graph.limbs)]
    page.choice("points", "colours tell", (PLAIN, REACH, *whys, POLICY), PLAIN, viewer.mark)
    page.text("legend", missing(*NEEDED, extra="agents"))
    page.checkbox("tree", "explored steps", False, lambda on: viewer.switch("tree", on))
    page.checkbox("path", "path and footholds", True, lambda on: viewer.switch("plan", on))
    page.checkbox("ghost", "plan before, pale", True, lambda on: viewer.switch("ghost", on))
    page.checkbox(
        "checked", "collision shapes alone", False, viewer.show_checked,
        "hide the rods that stand for joints, with which nothing is checked",
    )  # fmt: skip
    page.checkbox("walls", "leave out walls in front", True, viewer.leave_out)
