"""A second plan for comparison, drawn in the same module or in a second module below."""

from __future__ import annotations

import numpy as np

from mlivr_gym.motion.plan import Plan
from mlivr_gym.viewer import drawing
from mlivr_gym.viewer.frames import Frames
from mlivr_gym.viewer.page import Page
from mlivr_gym.viewer.solids import Scene
from mlivr_gym.world.grasp_map import GraspMap

SECOND_OFFSET = np.array([0.0, 0.0, -3.4])
"""Position of the second module relative to the first [m]."""

SEPARATE, OVERLAID, HIDDEN = "in a module below", "in the same module", "hidden"
"""Choices of where the second plan is shown."""


class SecondPlan:
    """A second plan on a page; all its nodes have names that start with `second`."""

    def __init__(self, page: Page, scene: Scene, plan: Plan, frames: Frames) -> None:
        """Store the plan, which `place` draws."""
        self.plan, self.frames = plan, frames
        self._page, self._scene = page, scene

    def place(self, where: str, grasp_map: GraspMap) -> None:
        """Draw the plan translucent in the same module, in a second module below, or not at all."""
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
        """Show the robot at a time [s]."""
        if "second/robot" in self._page:
            shown = self.frames.configuration(self.frames.at(time))
            drawing.pose_robot(self._page, "second/robot", self._scene, shown)
