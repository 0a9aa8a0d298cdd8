"""Renderer of an environment: pictures, films and a window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration
from mlivr_gym.envs.snapshots import Snapshot, snapshot_frames
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.captions import strip_height, with_caption
from mlivr_gym.pictures.films import AZIMUTH, ELEVATION, RATE
from mlivr_gym.pictures.rendering import SceneRenderer, SceneWindow
from mlivr_gym.pictures.route import Route
from mlivr_gym.stances.stance_graph import StanceGraph

RENDER_FPS = {"rgb_array": 2, "rgb_array_list": RATE, "human": 2}
"""Pictures per second by render mode: stills, a film, or a window."""

VIEW_MARGIN = 1.2
"""Minimum length of cabin that is visible on either side of robot and goal [m]."""

Picture = NDArray[np.uint8]
"""Colours of a picture, shape (height, width, 3)."""


class EnvViewer:
    """Renderer of the robot in its scene, which is built again only if the obstacles change."""

    def __init__(self, graph: StanceGraph, size: tuple[int, int], goal_tolerance: float) -> None:
        """Prepare to draw map, robot and obstacles of `graph`; `size` is width and height [px]."""
        self.graph, self._size, self._goal_tolerance = graph, size, goal_tolerance
        self.scene: SceneRenderer | SceneWindow | None = None
        self._snapshots: list[Snapshot] = []
        self._returned_first = False

    def follow(self, snapshot: Snapshot, mode: str | None) -> None:
        """Show or store a snapshot after an action or a reset, if the render mode requires it."""
        if mode == "human":
            self.render(snapshot, mode)
        if mode == "rgb_array_list":
            if snapshot.steps == 0:
                self._snapshots, self._returned_first = [], False
            self._snapshots.append(snapshot)

    def render(self, snapshot: Snapshot, mode: str | None) -> Picture | list[Picture] | None:
        """Return what `MlivrEnv.render` returns for the present snapshot."""
        if mode is None:
            gymnasium.logger.warn(
                "render() was called without a render_mode; give one to gymnasium.make"
            )
        elif mode == "human":
            self._show(snapshot.configuration(self.graph))
        elif mode == "rgb_array":
            return self.pictures([snapshot])[0]
        else:
            pictures = self.pictures(self._snapshots)[int(self._returned_first) :]
            self._snapshots, self._returned_first = self._snapshots[-1:], True
            return pictures
        return None

    def pictures(self, snapshots: Sequence[Snapshot]) -> list[Picture]:
        """Return the pictures of a sequence of snapshots, see `snapshot_frames`.

        Each has shape (height, width, 3) and shows the goal and the path of the base. Raises a
        `RenderError` if no GL library works.
        """
        out: list[Picture] = []
        stances: list[Array] = []
        line: list[Array] = []
        for snapshot, configurations in zip(
            snapshots, snapshot_frames(self.graph, snapshots), strict=True
        ):
            if snapshot.steps == 0:
                stances, line = [], []
            last = None
            for configuration in configurations:
                if configuration is not last:
                    line.append(configuration[0])
                    picture = self._picture(configuration, snapshot, line, stances)
                out.append(picture)
                last = configuration
            stances.append(configurations[-1][0])
        return out

    def _picture(
        self,
        configuration: Configuration,
        snapshot: Snapshot,
        line: Sequence[Array],
        stances: Sequence[Array],
    ) -> Picture:
        """Return one picture with its caption."""
        graph, scene, (width, height) = self.graph, self._current_scene(), self._size
        lower = height - strip_height(height)
        if not isinstance(scene, SceneRenderer):
            scene = SceneRenderer(graph.grasp_map, graph.robot, width, lower, graph.obstacles)
            self.scene = scene
        places = np.array(stances).reshape(-1, 3)
        route = Route(np.array(line), places, snapshot.goal, self._goal_tolerance, ())
        camera = self._camera(configuration[0], snapshot.goal, width / lower)
        picture = scene.render(*configuration, camera=camera, route=route)
        far = float(np.linalg.norm(configuration[0] - snapshot.goal))
        return with_caption(
            picture, f"step {snapshot.steps}: {snapshot.caption}; {far:.2f} m to the goal", height
        )

    def _camera(self, base: Array, goal: Array, aspect: float) -> Camera:
        """Return a camera that sees robot and goal, and the cabin from deck to overhead."""
        low, high = np.array(self.graph.grasp_map.cabin)
        ends = min(base[0], goal[0]) - VIEW_MARGIN, max(base[0], goal[0]) + VIEW_MARGIN
        middle = 0.5 * (low[1:] + high[1:])
        corners = np.array([[x, middle[0], z] for x in ends for z in (low[2], high[2])])
        camera = Camera((0.5 * sum(ends), *middle.tolist()), azimuth=AZIMUTH, elevation=ELEVATION)
        return camera.seeing(corners, 0.0, aspect)

    def _show(self, configuration: Configuration) -> None:
        """Show a configuration in a window.

        Raises a `RenderError` if there is no screen.
        """
        graph, scene = self.graph, self._current_scene()
        if not isinstance(scene, SceneWindow):
            scene = SceneWindow(graph.grasp_map, graph.robot, graph.obstacles)
            self.scene = scene
        scene.show(*configuration)

    def _current_scene(self) -> SceneRenderer | SceneWindow | None:
        """Return the scene if it has the present obstacles; otherwise close it and return None."""
        if self.scene is not None and self.scene.obstacles != self.graph.obstacles:
            self.close()
        return self.scene

    def close(self) -> None:
        """Release the window or GL context."""
        if self.scene is not None:
            self.scene.close()
            self.scene = None

    def __getstate__(self) -> dict[str, Any]:
        """Return all attributes for pickling, without the window or GL context."""
        return self.__dict__ | {"scene": None}
