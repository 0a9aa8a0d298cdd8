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
from mlivr_gym.simulation.recording import Recording
from mlivr_gym.transitions.state import State
from mlivr_gym.viewer import drawing, marks
from mlivr_gym.viewer.curves import Plot, margins, recorded, with_cursor
from mlivr_gym.viewer.frames import AT_REST, Frames, plan_frames, recording_frames
from mlivr_gym.viewer.live_plan import LivePlan
from mlivr_gym.viewer.page import Page
from mlivr_gym.viewer.panel_texts import legend_text, summary
from mlivr_gym.viewer.solids import scene_solids

TICK = 0.05
"""Time between two pictures while playing [s]."""

ASPECT = 1.15
"""Width divided by height of the scene next to the panel, for which the first view is chosen."""

PLOT_TICKS = 5
"""Number of pictures between two updates of the plots while playing."""

PLOTS = ("margins", "torques", "forces")
"""Names of the plots below the scrubber."""

AIM = "aim"
"""Node name of the arrows at the goal."""

CURSOR = "now", "#adb5bd"
"""Label and colour of the vertical line in the plots."""

EXPLAIN, BLOCK = "explain why it cannot be held", "block or free it"
"""Effects of a click on a point, in addition to starting a limb there."""

PLAIN, REACH, WHY = "nothing", "reach of the stance", "why not limb "
"""Meanings of the colours of points."""


class Viewer:
    """A live plan on a page, at a `time` [s] of its frames, `playing` or not at a `speed`."""

    def __init__(
        self, page: Page, live: LivePlan, recording: Recording | None = None, capsules: bool = False
    ) -> None:
        """Draw module and robot; `refresh` draws the plan, or its execution if recorded."""
        self.page, self.live, self.recording = page, live, recording
        self.scene = scene_solids(live.graph.grasp_map, live.graph.robot, capsules)
        self.time, self.playing, self.speed = 0.0, False, 1.0
        self.click, self.colouring, self.walls_hidden = EXPLAIN, PLAIN, True
        self._lock, self._closed = threading.RLock(), threading.Event()
        self._marked: tuple[object, ...] = ()
        self._plots: dict[str, Plot] = {}
        self._states: tuple[State | None, ...] = ()
        self._ticks = self._boxes = 0
        self._hidden = frozenset({"tree"})
        grasp_map, goal = live.graph.grasp_map, np.array(live.query.goal)
        seen = drawing.visible_positions(grasp_map, goal, live.plan)
        self.hide_walls_from(drawing.draw_stage(page, grasp_map, self.scene, seen, ASPECT))
        self.frames = self._frames()

    def _frames(self) -> Frames:
        """Return the frames to play: the execution, else the plan, else the start alone."""
        live = self.live
        self.page.show("robot", True)
        if self.recording is not None:
            return recording_frames(self.recording)
        if live.plan is not None:
            return plan_frames(live.graph, live.plan)
        start = live.start_configuration()
        if start is None:
            self.page.show("robot", False)
            start = np.zeros(3), drawing.IDENTITY, np.zeros((live.graph.limbs, 6))
        x, q, joints = (np.asarray(part)[None] for part in start)
        zero = np.zeros(1, dtype=np.int64)
        return Frames(np.zeros(1), zero, zero + AT_REST, x, q, joints)

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
            self.recording = None
            self.refresh()
        if self.live.plan is None:
            threading.Thread(
                target=self._explain_missing_plan, args=(self.live.message,), daemon=True
            ).start()

    def _explain_missing_plan(self, message: str) -> None:
        """Search for the cause that no plan exists; show it unless the query has changed again."""
        try:
            cause = self.live.cause()
        except MlivrError as error:
            cause = str(error)
        with self._lock:
            if cause and self.live.message == message and not self._closed.is_set():
                self.page.write("summary", summary(self.live, cause))

    def refresh(self) -> None:
        """Redraw everything that depends on the plan, and go to its start."""
        live, page, graph = self.live, self.page, self.live.graph
        with self._lock, page.server.atomic():
            self.frames = self._frames()
            goal = np.array(live.query.goal)
            drawing.draw_query(page, graph, live.plan, goal, live.query.goal_tolerance)
            drawing.draw_pale_path(page, "ghost", live.previous)
            if AIM in page:
                page.nodes[AIM].position = goal
            drawing.draw_tree(page, live.tree)
            for name in self._hidden:
                page.show(name, False)
            self._states = marks.states_of(graph, live.plan) if live.plan is not None else ()
            self._marked = ()
            self._show_plots()
            page.write("summary", summary(live))
            page.items["time"].max = max(self.frames.duration, 0.1)
            self.seek(0.0)

    def _show_plots(self) -> None:
        """Compute the plots and set their titles and curves."""
        plan = self.live.plan
        plots: dict[str, Plot] = {}
        if plan is not None:
            plots["margins"] = margins(self.frames, plan)
        if self.recording is not None:
            plots |= recorded(self.recording)
        self._plots = {name: plot for name, plot in plots.items() if plot.curves}
        for name in PLOTS:
            plot = self._plots.get(name)
            if plot is None:
                self.page.set_curves(name, "", (), 1.0)
                continue
            curves = [(label, colour) for label, colour, _ in plot.curves]
            self.page.set_curves(name, plot.title, [*curves, CURSOR], plot.highest)

    # Playing.

    def seek(self, time: float) -> None:
        """Show a time [s]."""
        with self._lock, self.page.server.atomic():
            self.time = min(max(time, 0.0), self.frames.duration)
            k = self.frames.at(self.time)
            drawing.pose_robot(self.page, "robot", self.scene, self.frames.configuration(k))
            plan = self.live.plan
            self.page.write("where", self.frames.describe(k, plan) if plan else "the start")
            self.page.items["time"].value = round(self.time, 2)
            if not self.playing or self._ticks % PLOT_TICKS == 0:
                for name, plot in self._plots.items():
                    times, values = with_cursor(plot, self.time)
                    self.page.items[name].data = (times, *values)
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
            if not self.playing:
                return
            self._ticks += 1
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
            self._explain_point(point)
        else:
            self.change(lambda: self.live.set_start_point(int(self.click.split()[-1]), name))

    def _explain_point(self, point: int) -> None:
        """Show which limbs can step to a point now, and why others cannot."""
        with self._lock:
            graph, state = self.live.graph, self.present_state()
            lines = [f"**{graph.grasp_map.ids[point]}**, {graph.grasp_map.faces[point]}"]
            if state is not None:
                steps = graph.successors(state)
                for limb in range(graph.limbs):
                    why = marks.why_not(graph, state, limb, point, steps)
                    lines.append(f"limb {limb}: {why or 'can step to this point'}")
            self.page.write("explanation", "  \n".join(lines))

    def present_state(self) -> State | None:
        """Return the state of the stance that is shown, or from which the shown step starts."""
        k = self.frames.at(self.time)
        number = min(int(self.frames.step[k]), len(self._states) - 1)
        return self._states[number] if self._states else None

    def set_colouring(self, what: str) -> None:
        """Choose the meaning of the colours of points."""
        with self._lock:
            self.colouring = what
            self._mark()

    def _mark(self) -> None:
        """Colour the points if anything has changed that their colours depend on."""
        graph, state = self.live.graph, self.present_state()
        key = (self.colouring, state, graph.version, self.live.query.goal)
        if key == self._marked:
            return
        self._marked = key
        try:
            colours = self._marks(state)
        except MlivrError as error:
            colours = marks.plain_marks(graph)._replace(legend=[("#c92a2a", str(error))])
        drawing.colour_points(self.page, graph.grasp_map, colours)
        self.page.write("legend", legend_text(colours))

    def _marks(self, state: State | None) -> marks.Marks:
        """Return the colours of points in a state."""
        graph = self.live.graph
        if self.colouring == PLAIN or state is None:
            return marks.plain_marks(graph)
        if self.colouring == REACH:
            return marks.reach_marks(graph, state)
        return marks.blocked_marks(graph, state, int(self.colouring.removeprefix(WHY)))

    def hide_walls_from(self, eye: Array) -> None:
        """Hide the walls, if that is chosen, that a camera at `eye` [m] sees from behind."""
        self._eye, grasp_map = eye, self.live.graph.grasp_map
        if not self._lock.acquire(blocking=False):
            return  # busy; the next movement of the camera calls this again
        try:
            hidden = drawing.hidden_faces(grasp_map, eye) if self.walls_hidden else set()
            with self.page.server.atomic():
                for face in drawing.points_by_face(grasp_map):
                    self.page.show(f"module/{face}", face not in hidden)
                    self.page.show(f"points/{face}", face not in hidden)
        finally:
            self._lock.release()

    def set_walls_hidden(self, hidden: bool) -> None:
        """Choose whether walls between the camera and the inside are hidden."""
        self.walls_hidden = hidden
        self.hide_walls_from(self._eye)

    def set_visible(self, name: str, visible: bool) -> None:
        """Show or hide explored steps, the plan or the previous plan, by the name of the node."""
        self._hidden = self._hidden - {name} if visible else self._hidden | {name}
        self.page.show(name, visible)

    def show_collision_shapes(self, alone: bool) -> None:
        """Show the collision shapes alone, or with what is drawn in their place."""
        drawing.show_collision_shapes(self.page, "robot", self.scene, alone)

    def add_box(self) -> None:
        """Add a box in the middle of the base path, with arrows to drag it."""
        name = f"added{self._boxes}"
        self._boxes += 1
        plan = self.live.shown
        positions = np.array([self.live.query.goal]) if plan is None else plan.motion.base_positions
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
        self.page.remove("handles")
        self.change(self.live.clear)
