"""A plan that another is compared with, drawn in the same module or in one below."""

from __future__ import annotations

import numpy as np

from mlivr_gym.motion.plan import Plan
from mlivr_gym.viewer import drawing
from mlivr_gym.viewer.frames import Frames
from mlivr_gym.viewer.page import Page
from mlivr_gym.viewer.solids import Scene
from mlivr_gym.world.grasp_map import GraspMap

SECOND_OFFSET = np.array([0.0, 0.0, -3.4])
"""How far from the module a second one stands [m]."""

SEPARATE, OVERLAID, HIDDEN = "in a module below", "in the same module", "hidden"
"""Where a second plan is shown."""


class SecondPlan:
    """Draws a plan below the name `second`.

    Attributes
    ----------
    plan
        The plan.
    frames
        What is played of it.
    """

    def __init__(self, page: Page, scene: Scene, plan: Plan, frames: Frames) -> None:
        """Draw nothing yet."""
        self.plan, self.frames = plan, frames
        self._page, self._scene = page, scene

    def place(self, where: str, grasp_map: GraspMap) -> None:
        """Draw it in the same module, translucent, in one below, or not at all."""
        page = self._page
        page.remove("second")
        if where == HIDDEN:
            return
        page.frame("second", position=SECOND_OFFSET if where == SEPARATE else np.zeros(3))
        opacity = 1.0 if where == SEPARATE else drawing.GHOST_OPACITY
        drawing.draw_robot(page, "second/robot", self._scene, opacity)
        if where == OVERLAID:
            drawing.draw_pale_path(page, "second/path", self.plan)
        else:
            drawing.draw_plan(page, "second/plan", grasp_map, self.plan)
            drawing.draw_module(page, "second/module", self._scene)

    def seek(self, time: float) -> None:
        """Show a time [s]."""
        if "second/robot" in self._page:
            shown = self.frames.configuration(self.frames.at(time))
            drawing.pose_robot(self._page, "second/robot", self._scene, shown)
