"""Export of a plan or an execution as one HTML file that plays without a server."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mlivr_gym.errors import SettingError
from mlivr_gym.files import write_whole
from mlivr_gym.motion.plan import Plan
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.viewer.frames import STEP_TIME, Frames
from mlivr_gym.viewer.live_plan import LivePlan, query_of
from mlivr_gym.viewer.page import Page
from mlivr_gym.viewer.viewer import Viewer

MAX_BYTES = 2_000_000
"""Maximum size of a file in bytes; long plans have fewer frames, so that files can be shared."""

FRAME_RATE = 20.0
"""Maximum number of frames in a second."""

ASPECT = 1.75
"""Width divided by height of the window for which the first view is chosen."""


def write_html(
    path: str | Path, graph: StanceGraph, plan: Plan, executed: Frames | None = None,
    capsules: bool = False,
) -> int:  # fmt: skip
    """Write a page that plays a plan, or its execution, and return the size of the file in bytes.

    The page loads nothing from elsewhere. The frames of an execution are played at a speed at which
    a step takes `STEP_TIME` on average, like a step of a plan. `capsules` draws the collision
    shapes in place of visual meshes, as for more than two limbs, whose meshes would need most of
    `MAX_BYTES`. Raises a `FileError` if the file cannot be written, and a `SettingError` if the
    file would be larger than `MAX_BYTES` even with few frames.
    """
    page, live = Page("127.0.0.1", 0, "mlivr-gym"), LivePlan(graph, query_of(graph, plan), plan)
    kind, capsules = "plan" if executed is None else "execution", capsules or graph.limbs > 2
    title = (
        f"{plan.world.robot.name}: {kind}, {len(plan.steps)} steps, "
        f"{plan.base_translation:.3f} m, {plan.query.cost_name} cost"
    )
    try:
        viewer = Viewer(page, live, executed, capsules=capsules, aspect=ASPECT)
        content = _content(viewer, max(STEP_TIME * len(plan.steps), STEP_TIME), title)
    finally:
        page.close()
    write_whole(path, content)
    return len(content)


def _content(viewer: Viewer, length: float, title: str) -> bytes:
    """Return the HTML of a page that plays for a time [s], with as many frames as it may have."""
    times = viewer.frames.times
    count = min(len(times), round(FRAME_RATE * length) + 1)
    while count >= 2:
        chosen = np.linspace(0, len(times) - 1, count).round().astype(np.int64)
        content = viewer.page.record(times[chosen], length / (count - 1), viewer.seek, title)
        if len(content.encode()) <= MAX_BYTES:
            return content.encode()
        count //= 2
    raise SettingError(
        f"the page of this scene would be larger than {MAX_BYTES} bytes; "
        "use a map or a plan with fewer shapes, capsules in place of meshes, or serve the page"
    )
