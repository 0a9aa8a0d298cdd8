"""Draws an environment, as pictures or in a window."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array
from mlivr_gym.pictures.rendering import SceneRenderer, SceneWindow
from mlivr_gym.stances.stance_graph import StanceGraph


class Viewer:
    """Shows the robot in its scene, which is built anew only for other obstacles.

    Attributes:
        scene: The scene with its GL context or window; None until something is drawn.
    """

    def __init__(self, graph: StanceGraph, width: int, height: int) -> None:
        """Draw the map, robot and obstacles of `graph`; pictures are `width` by `height` px."""
        self.graph, self._size = graph, (width, height)
        self.scene: SceneRenderer | SceneWindow | None = None

    def picture(self, configuration: tuple[Array, Array, Array]) -> NDArray[np.uint8]:
        """Picture of a configuration, shape (height, width, 3).

        Args:
            configuration: Base position [m], base quaternion w, x, y, z, and joint angles [rad].

        Raises:
            RenderError: If there is no GL library.
        """
        graph, scene = self.graph, self._present()
        if not isinstance(scene, SceneRenderer):
            scene = SceneRenderer(graph.grasp_map, graph.robot, *self._size, graph.obstacles)
            self.scene = scene
        return scene.render(*configuration)

    def show(self, configuration: tuple[Array, Array, Array]) -> None:
        """Show a configuration in a window; see `picture`.

        Raises:
            RenderError: If there is no screen.
        """
        graph, scene = self.graph, self._present()
        if not isinstance(scene, SceneWindow):
            scene = SceneWindow(graph.grasp_map, graph.robot, graph.obstacles)
            self.scene = scene
        scene.show(*configuration)

    def _present(self) -> SceneRenderer | SceneWindow | None:
        """The scene, if it has the present obstacles; another is closed."""
        if self.scene is not None and self.scene.obstacles != self.graph.obstacles:
            self.close()
        return self.scene

    def close(self) -> None:
        """Release the window or GL context."""
        if self.scene is not None:
            self.scene.close()
            self.scene = None

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the window or GL context."""
        return self.__dict__ | {"scene": None}
