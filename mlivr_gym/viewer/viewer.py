"""The viewer: it shows a live plan on a page and responds to what users do there.

Methods that the page calls run in threads of the server and hold a lock while they work; one more
thread plays.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError
from mlivr_gym.transitions.state import State
from mlivr_gym.viewer import drawing, marks
from mlivr_gym.viewer.frames import Frames, plan_frames, stance_frames
from mlivr_gym.viewer.live_plan import LivePlan
from mlivr_gym.viewer.page import Page

TICK = 0.05
"""Time between two pictures while playing [s]."""

ASPECT = 1.15
"""Width divided by height of the scene next to the panel, for which the first view is chosen."""

AIM, NOW = "aim", "now"
"""Node names of the arrows at the goal, and of the text above the robot."""

ABOVE = np.array([0.0, 0.0, 0.5])
"""Position of the text relative to the base [m]."""

EXPLAIN, BLOCK = "explain why it cannot be held", "block or free it"
"""Effects of a click on a point, in addition to starting a limb there."""


class Viewer:
    """A live plan on a page, at a `time` [s] of its frames, `playing` or not at a `speed`."""

    def __init__(
        self, page: Page, live: LivePlan, executed: Frames | None = None, *,
        capsules: bool = False, aspect: float = ASPECT,
    ) -> None:  # fmt: skip
        """Draw the module, the robot and the plan, or the frames of its execution."""
        self.page, self.live, self.executed = page, live, executed
        self.time, self.playing, self.speed = 0.0, False, 1.0
        self.click, self.reach_shown, self._boxes = EXPLAIN, False, 0
        self._lock, self._closed = threading.RLock(), threading.Event()
        self._marked: tuple[object, ...] = ()
        grasp_map = live.graph.grasp_map
        self._model = drawing.draw_stage(page, grasp_map, live.graph.robot, capsules)
        page.label(NOW, "", ABOVE)
        self.hide_walls_from(drawing.aim_camera(page, grasp_map.positions, aspect))
        self.refresh()

    # Changes of the query.

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
            self._states: tuple[State | None, ...] = ()
            if live.plan is None:
                none = np.zeros((1, 3)), np.eye(1, 4), np.zeros((1, graph.limbs, 6))
                self.frames = stance_frames(*none)
            else:
                self.frames = self.executed or plan_frames(graph, live.plan)
                self._states = marks.states_of(graph, live.plan)
            page.show("robot", live.plan is not None)
            drawing.draw_plan(page, graph.grasp_map, live.plan, live.previous)
            drawing.draw_world(page, graph.obstacles, live.goal, live.query["goal_tolerance"])
            if AIM in page.nodes:
                page.nodes[AIM].position = live.goal
            page.write("summary", live.summary())
            self._marked = ()
            self.seek(0.0)

    # Playing.

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
            self.page.move_slider(self.time, self.frames.duration)
            self._mark()

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

    def jump(self, count: int) -> None:
        """Go forward, or back for a negative count, by some steps to the start of a step."""
        with self._lock:
            starts = self.frames.starts()
            here = int(np.searchsorted(starts, self.time + 1e-6, side="right")) - 1
            back = count < 0 and self.time > starts[here] + 1e-6
            self.scrub(float(starts[np.clip(here + count + back, 0, len(starts) - 1)]))

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

    # Points, walls and boxes.

    def clicked(self, point: int) -> None:
        """Handle a click on a point, given by its index."""
        name = self.live.graph.grasp_map.ids[point]
        if self.click == BLOCK:
            self.change(lambda: self.live.toggle_occupied(name))
        elif self.click == EXPLAIN:
            self._explain(point)
        else:
            self.change(lambda: self.live.set_start_point(int(self.click.split()[-1]), name))

    def _explain(self, point: int) -> None:
        """Show which limbs can step to a point now, and why others cannot."""
        with self._lock:
            graph, state = self.live.graph, self.present_state()
            lines = [f"**{graph.grasp_map.ids[point]}**, {graph.grasp_map.faces[point]}"]
            if state is not None:
                lines += marks.explanations(graph, state, point)
            self.page.write("explanation", "  \n".join(lines))

    def present_state(self) -> State | None:
        """Return the state of the stance that is shown, or from which the shown step starts."""
        number = int(self.frames.step[self.frames.at(self.time)])
        return self._states[min(number, len(self._states) - 1)] if self._states else None

    def show_reach(self, shown: bool) -> None:
        """Choose whether points that limbs can step to have the colours of the limbs."""
        with self._lock:
            self.reach_shown = shown
            self._mark()

    def _mark(self) -> None:
        """Colour the points if anything has changed that their colours depend on."""
        graph, state = self.live.graph, self.present_state() if self.reach_shown else None
        if (state, graph.version) == self._marked:
            return
        self._marked = state, graph.version
        colours = marks.point_marks(graph, state)
        drawing.colour_points(self.page, graph.grasp_map, colours)
        lines = [f'<span style="color:{c}">⬤</span> {text}' for c, text in colours.legend]
        self.page.write("legend", "  \n".join(lines))

    def hide_walls_from(self, eye: Array) -> None:
        """Hide the walls that a camera at `eye` [m] sees from behind."""
        if self._lock.acquire(blocking=False):  # otherwise the camera's next movement calls it
            try:
                with self.page.server.atomic():
                    drawing.hide_walls(self.page, self.live.graph.grasp_map, eye)
            finally:
                self._lock.release()

    def add_box(self) -> None:
        """Add a box in the middle of the base path, with arrows to drag it."""
        name = f"added{self._boxes}"
        self._boxes += 1
        plan = self.live.plan or self.live.previous
        positions = self.live.goal[None] if plan is None else plan.motion.base_positions
        position = positions[len(positions) // 2] + np.array([0.0, 0.0, -0.35])
        self.change(lambda: self.live.put_box(name, position))
        if any(box.id == name for box in self.live.graph.obstacles):
            self.page.gizmo(
                f"handles/{name}",
                position,
                lambda at: self.change(lambda: self.live.put_box(name, at)),
            )

    def clear(self) -> None:
        """Remove all obstacles and free all points."""
        self.page.clear("handles")
        self.change(self.live.clear)
