"""The viewer: it shows a live plan on a page and responds to what users do there.

Methods that the page calls run in threads of the server and hold a lock while they work; one more
thread plays. `add_panel` connects the page with them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mlivr_gym.errors import MlivrError
from mlivr_gym.extensions.viewer import drawing
from mlivr_gym.extensions.viewer.frames import FRAME_TIME, STEP_TIME, Frames, no_frames, plan_frames
from mlivr_gym.extensions.viewer.live_plan import (
    LivePlan,
    explanations,
    query_of,
    states_of,
)
from mlivr_gym.extensions.viewer.page import Page
from mlivr_gym.files import write_whole
from mlivr_gym.motion import Plan
from mlivr_gym.stances import StanceGraph, State

TICK = 0.05
"""Time between two pictures while playing [s]."""

ASPECT, WIDE = 1.15, 1.75
"""Width divided by height of the scene, next to the panel and in a file, for the first view."""

AIM, NOW = "aim", "now"
"""Node names of the arrows at the goal, and of the text above the robot."""

ABOVE = np.array([0.0, 0.0, 0.5])
"""Position of the text relative to the base [m]."""

EXPLAIN, BLOCK = "explain why it cannot be held", "block or free it"
"""Effects of a click on a point."""

MOST_PICTURES = 401
"""Largest number of pictures in a file: long plans have fewer in a second, so that files stay small
enough to be shared."""

SPEEDS = ("0.25x", "0.5x", "1x", "2x", "5x", "10x", "20x")
"""Speeds to choose from, relative to the time of the frames."""


class Viewer:
    """A live plan on a page, at a `time` [s] of its frames, `playing` or not at a `speed`."""

    def __init__(
        self, page: Page, live: LivePlan, executed: Frames | None = None, *,
        capsules: bool = False, aspect: float = ASPECT,
    ) -> None:  # fmt: skip
        """Draw the module, the robot and the plan, or the frames of its execution."""
        self.page, self.live, self.executed = page, live, executed
        self.time, self.playing, self.speed = 0.0, False, 1.0
        self.click = EXPLAIN
        self._lock, self._closed = threading.RLock(), threading.Event()
        grasp_map = live.graph.grasp_map
        self._model = drawing.draw_stage(page, grasp_map, live.graph.robot, capsules)
        page.label(NOW, "", ABOVE)
        drawing.hide_walls(page, grasp_map, drawing.aim_camera(page, grasp_map.positions, aspect))
        self.refresh()

    def change(self, act: Callable[[], None]) -> None:
        """Change the query by `act` and show the result, or the error if the change is invalid."""
        with self._lock:
            self.page.write("summary", "*planning ...*")
            try:
                act()
            except MlivrError as error:
                self.page.write("summary", f"**{error}**")
                return
            self.executed = None
            self.refresh()

    def refresh(self) -> None:
        """Redraw everything that depends on the plan, and go to its start."""
        live, page, graph = self.live, self.page, self.live.graph
        with self._lock, page.server.atomic():
            if live.plan is None:
                self.frames = no_frames(graph.limbs)
            else:
                self.frames = self.executed or plan_frames(graph, live.plan)
            page.show("robot", live.plan is not None)
            drawing.draw_plan(page, graph.grasp_map, live.plan)
            drawing.draw_world(page, graph.obstacles, live.goal, live.query["goal_tolerance"])
            if AIM in page.nodes:
                page.nodes[AIM].position = live.goal
            drawing.colour_points(page, graph.grasp_map, graph.occupied)
            page.write("summary", live.summary())
            self.seek(0.0)

    def seek(self, time: float) -> None:
        """Show a time [s]."""
        with self._lock, self.page.server.atomic():
            self.time = min(max(time, 0.0), self.frames.duration)
            k, label = self.frames.at(self.time), self.page.nodes[NOW]
            drawing.pose_robot(self.page, self._model, self.frames.configuration(k))
            text = self.frames.describe(k, self.live.plan) if self.live.plan else ""
            label.position = np.float32(self.frames.base_positions[k] + ABOVE)
            if label.text != text:
                label.text = text
            slider = self.page.items.get("time")
            if slider is not None:
                slider.max, slider.value = max(self.frames.duration, 0.1), round(self.time, 2)

    def scrub(self, time: float) -> None:
        """Show a time [s] chosen on the page, and stop playing."""
        self.playing = False
        self.seek(time)

    def toggle(self) -> None:
        """Play or pause; at the end, play from the start."""
        with self._lock:
            if not self.playing and self.time >= self.frames.duration:
                self.time = 0.0
            self.playing = not self.playing

    def tick(self) -> None:
        """Advance by one picture if it is playing."""
        with self._lock:
            if self.playing:
                self.playing = self.time + TICK * self.speed < self.frames.duration
                self.seek(self.time + TICK * self.speed)

    def run(self) -> None:
        """Play until the viewer is closed."""
        while not self._closed.wait(TICK):
            self.tick()

    def close(self) -> None:
        """Stop playing and serving."""
        self._closed.set()
        self.page.close()

    def clicked(self, point: int) -> None:
        """Block or free a point, or show which limbs can step to it now, and why others cannot."""
        graph = self.live.graph
        name, face = graph.grasp_map.ids[point], graph.grasp_map.faces[point]
        if self.click == BLOCK:
            self.change(lambda: self.live.toggle_occupied(name))
            return
        with self._lock:
            lines, state = [f"**{name}**, {face}"], self.present_state()
            if state is not None:
                lines += explanations(graph, state, point)
            self.page.write("explanation", "  \n".join(lines))

    def present_state(self) -> State | None:
        """Return the state of the stance that is shown, or from which the shown step starts."""
        number = int(self.frames.step[self.frames.at(self.time)])
        return states_of(self.live.graph, self.live.plan)[number] if self.live.plan else None


def add_panel(viewer: Viewer) -> None:
    """Add the panel, and connect the page with the viewer's methods."""
    page, gui, grasp_map = viewer.page, viewer.page.gui, viewer.live.graph.grasp_map
    page.items["summary"] = gui.add_markdown("")
    page.item("time", gui.add_slider("time [s]", 0.0, 0.1, 0.01, 0.0), viewer.scrub)
    gui.add_button("Play or pause").on_click(lambda _: viewer.toggle())
    speed = gui.add_dropdown("speed", SPEEDS, initial_value=f"{viewer.speed:g}x")
    page.item("speed", speed, lambda chosen: setattr(viewer, "speed", float(chosen[:-1])))
    clicks = gui.add_dropdown("a click on a point", (EXPLAIN, BLOCK), initial_value=viewer.click)
    page.item("click", clicks, lambda chosen: setattr(viewer, "click", chosen))
    page.items["explanation"] = gui.add_markdown("")
    for face, points in drawing.points_by_face(grasp_map).items():
        page.nodes[f"points/{face}"].on_click(
            lambda event, points=points: viewer.clicked(int(points[event.instance_index]))
        )
    page.gizmo(AIM, viewer.live.goal, lambda at: viewer.change(lambda: viewer.live.set_goal(at)))
    page.server.on_client_connect(
        lambda client: client.camera.on_update(
            lambda camera: drawing.hide_walls(page, grasp_map, np.array(camera.position))
        )
    )
    viewer.refresh()


def write_html(
    path: str | Path, graph: StanceGraph, plan: Plan, executed: Frames | None = None,
    capsules: bool = False,
) -> int:  # fmt: skip
    """Write a page that plays a plan, or its execution, and return the size of the file in bytes.

    The page loads nothing from elsewhere. The frames of an execution are played at a speed at which
    a step takes `STEP_TIME` on average, like a step of a plan. `capsules` draws the collision
    shapes in place of visual meshes, as for more than two limbs, whose meshes would make the file
    large. Raises a `FileError` if the file cannot be written.
    """
    page, live = Page("127.0.0.1", 0, "mlivr-gym"), LivePlan(graph, query_of(graph, plan), plan)
    length = STEP_TIME * max(len(plan.steps), 1)
    try:
        viewer = Viewer(page, live, executed, capsules=capsules or graph.limbs > 2, aspect=WIDE)
        times = viewer.frames.times
        count = min(len(times), round(length / FRAME_TIME) + 1, MOST_PICTURES)
        chosen = np.linspace(0, len(times) - 1, count).round().astype(np.int64)
        content = page.record(times[chosen], length / (count - 1), viewer.seek).encode()
    finally:
        page.close()
    write_whole(path, content)
    return len(content)
