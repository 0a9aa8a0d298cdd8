"""Export of a plan or an execution as one HTML file that plays without a server."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mlivr_gym.errors import SettingError
from mlivr_gym.files import write_whole
from mlivr_gym.motion.plan import Plan
from mlivr_gym.simulation.recording import Recording
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.viewer import drawing, marks
from mlivr_gym.viewer.frames import STEP_TIME, plan_frames, recording_frames
from mlivr_gym.viewer.page import Page
from mlivr_gym.viewer.solids import scene_solids

MAX_BYTES = 2_000_000
"""Maximum size of a file in bytes; long plans have fewer frames, so that files can be shared."""

FRAME_RATE = 20.0
"""Maximum number of frames in a second."""

ASPECT = 1.75
"""Width divided by height of the window for which the first view is chosen."""

ABOVE = np.array([0.0, 0.0, 0.5])
"""Position of the label relative to the base [m]."""


def write_html(
    path: str | Path, graph: StanceGraph, plan: Plan, recording: Recording | None = None,
    capsules: bool = False,
) -> int:  # fmt: skip
    """Write a page that plays a plan, or its execution, and return the size of the file in bytes.

    The page loads nothing from elsewhere. An execution is played at a speed at which a step takes
    `STEP_TIME` on average, like a step of a plan. `capsules` draws the collision shapes in place of
    visual meshes, as for more than two limbs, whose meshes would need most of `MAX_BYTES`. Raises a
    `FileError` if the file cannot be written, and a `SettingError` if the file would be larger than
    `MAX_BYTES` even with few frames.
    """
    page = Page("127.0.0.1", 0, "mlivr-gym")
    try:
        content = _html_of_plan(page, graph, plan, recording, capsules or graph.limbs > 2)
    finally:
        page.close()
    write_whole(path, content)
    return len(content)


def _html_of_plan(
    page: Page, graph: StanceGraph, plan: Plan, recording: Recording | None, capsules: bool
) -> bytes:
    """Draw a plan or its execution on a page, and return its HTML."""
    grasp_map, scene = graph.grasp_map, scene_solids(graph.grasp_map, graph.robot, capsules)
    frames = plan_frames(graph, plan) if recording is None else recording_frames(recording)
    goal = np.array(plan.query.goal)
    positions = drawing.visible_positions(grasp_map, goal, plan)
    eye = drawing.draw_stage(page, grasp_map, scene, positions, ASPECT)
    drawing.colour_points(page, grasp_map, marks.plain_marks(graph))
    drawing.draw_query(page, graph, plan, goal, plan.query.goal_tolerance)
    for face in drawing.hidden_faces(grasp_map, eye):
        page.show(f"module/{face}", False)
        page.show(f"points/{face}", False)
    page.label("now", "", ABOVE)

    def draw(chosen: int) -> None:
        drawing.pose_robot(page, "robot", scene, frames.configuration(chosen))
        text, label = frames.describe(chosen, plan), page.nodes["now"]
        label.position = frames.base_positions[chosen] + ABOVE
        if label.text != text:
            label.text = text

    title = (
        f"{plan.world.robot.name}: {'plan' if recording is None else 'execution'}, "
        f"{len(plan.steps)} steps, {plan.base_translation:.3f} m, {plan.query.cost_name} cost"
    )
    length = STEP_TIME * max(int(frames.step.max()) + (recording is not None), 1)
    count = min(len(frames), round(FRAME_RATE * length) + 1)
    while count >= 2:
        shown = np.linspace(0, len(frames) - 1, count).round().astype(np.int64).tolist()
        content = page.record(shown, length / (count - 1), draw, title)
        if len(content.encode()) <= MAX_BYTES:
            return content.encode()
        count //= 2
    raise SettingError(
        f"the page of this scene would be larger than {MAX_BYTES} bytes; "
        "use a map or a plan with fewer shapes, capsules in place of meshes, or serve the page"
    )
