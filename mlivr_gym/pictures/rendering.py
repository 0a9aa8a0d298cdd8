"""Pictures of the MuJoCo scene.

Rendering without a screen needs EGL or OSMesa. If neither can be used, `SceneRenderer` raises a
`RenderError` that says what is missing, and callers may draw with matplotlib (`figures`).
"""

from __future__ import annotations

import atexit
import os
import sys
import weakref
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import Function, InstanceOf, Reader, checked
from mlivr_gym.arrays import Array
from mlivr_gym.collisions.contacts import Configuration, checked_configuration
from mlivr_gym.errors import RenderError, SceneError, SettingError
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.pictures.camera import CAMERA, Camera
from mlivr_gym.pictures.captions import with_caption, with_labels
from mlivr_gym.pictures.route import Label, Route
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import Anything, Choice, FieldPath, Flag, Integer, ListOf, OrNone
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap

GHOST_OPACITY = 0.22
"""Opacity of a ghost."""

MARGIN = 0.3
"""Margin round the map in a picture of the whole map [m]."""

WIDTH, HEIGHT = Integer(16, 1920), Integer(16, 1080)
"""Valid widths and heights of a picture [px], limited by the scene's frame buffer."""


def _size(value: object, place: FieldPath) -> tuple[int, int]:
    """Read the width and height of a picture."""
    width, height = ListOf(Anything(), 2, 2).read(value, place)
    return WIDTH.read(width, place.entry(0)), HEIGHT.read(height, place.entry(1))


SIZE = Reader(_size)
"""Validator of an argument that is the width and height of a picture [px]."""


class SceneRenderer:
    """Renderer of configurations of a robot in its module, with `obstacles` in addition.

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> graph = stance_graph()
    >>> renderer = SceneRenderer(graph.grasp_map, graph.robot)
    >>> image = renderer.render(*graph.configuration(graph.state(("D2a:4", "D2b:4"))))
    >>> image.shape
    (540, 960, 3)
    """

    @checked({**ARGUMENTS, "width": WIDTH, "height": HEIGHT, "capsules": Flag()})
    def __init__(
        self,
        grasp_map: GraspMap,
        robot: RobotSpec,
        width: int = 960,
        height: int = 540,
        obstacles: Sequence[Box] = (),
        capsules: bool = False,
    ) -> None:
        """Compile the scene and open a GL context.

        Limbs are drawn by their visual meshes where these ship, or, with `capsules`, by their
        collision shapes. Raises a `SceneError` if MuJoCo refuses the scene, and a `RenderError` if
        no GL library can be used.
        """
        from mlivr_gym.pictures.studio import studio_spec
        from mlivr_gym.simulation.gl import forget_context, mujoco, render_error
        from mlivr_gym.simulation.scene import compile_spec

        self.grasp_map, self._robot, self.obstacles = grasp_map, robot, tuple(obstacles)
        self._capsules = capsules
        self.model = compile_spec(studio_spec(grasp_map, robot, obstacles, capsules))
        self.data, self._size = mujoco.MjData(self.model), (width, height)
        self._rise = max(robot.heights) + 0.5 * float(robot.body_edges[2])
        try:
            self._renderer: Any = mujoco.Renderer(self.model, height, width)
            self._release = weakref.finalize(self, self._renderer.close)
            self._release.atexit = False
            # Registered after the GL loader's exit hook, hence run before it.
            atexit.register(self._release)
        except Exception as error:  # GL loaders raise errors of many kinds
            raise render_error(error) from None
        except BaseException as interruption:
            forget_context(interruption)
            raise

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy the scene; a copy opens a GL context of its own."""
        made_of = self.grasp_map, self._robot, *self._size, self.obstacles, self._capsules
        return type(self), made_of

    @checked(
        {
            **dict.fromkeys(("position", "quaternion", "joints"), Anything()),
            "hide": ListOf(Anything()),
            "camera": OrNone(CAMERA),
            "route": OrNone(InstanceOf(Route)),
            "ghosts": ListOf(Anything()),
            "draw": OrNone(Function()),
        }
    )
    def render(
        self,
        position: Array,
        quaternion: Array,
        joints: Array,
        *,
        hide: tuple[str, ...] = ("forward",),
        camera: Camera | None = None,
        route: Route | None = None,
        ghosts: Sequence[Configuration] = (),
        draw: Callable[[Any], None] | None = None,
    ) -> NDArray[np.uint8]:
        """Render one configuration; return the picture, shape (height, width, 3).

        The base position has shape (3,) [m], the quaternion is w, x, y, z, and joint angles have
        shape (N, 6) [rad]. The faces `hide` of the cabin are not drawn; the camera is by default
        one that sees the whole map. With the route of a plan, that is drawn, too, and with `ghosts`
        translucent copies of the robot in these configurations. `draw` is called with the
        `mujoco.MjvScene`, to which it may add shapes, see `scene_shapes`.
        """
        import mujoco

        from mlivr_gym.pictures.studio import aim
        from mlivr_gym.simulation.scene import FACE_GROUPS, set_configuration

        camera = camera or self.overview()
        aim(self.model, self.grasp_map, camera)
        standing = checked_configuration(self._robot, (position, quaternion, joints))
        set_configuration(self.model, self.data, *standing)
        options = mujoco.MjvOption()
        options.geomgroup[:] = 1
        options.sitegroup[:] = 1
        for face in ListOf(Choice(tuple(FACE_GROUPS))).read(hide, FieldPath("hide", SettingError)):
            options.geomgroup[FACE_GROUPS[face]] = 0
            options.sitegroup[FACE_GROUPS[face]] = 0
        eye = mujoco.MjvCamera()
        eye.lookat[:], eye.distance = camera.lookat, camera.distance
        eye.azimuth, eye.elevation = camera.azimuth, camera.elevation
        self._renderer.update_scene(self.data, eye, options)
        for ghost in ghosts:
            self._add_ghost(ghost, options)
        if draw is not None:
            draw(self._renderer.scene)
        if route is not None:
            route.add_to(self._renderer.scene)
        image: NDArray[np.uint8] = self._renderer.render().copy()
        return image if route is None else _labelled(image, camera, route.labels())

    def overview(self) -> Camera:
        """Return a camera that sees the whole map, and a robot anywhere on it."""
        points, normals = self.grasp_map.positions, self.grasp_map.normals
        points = np.concatenate([points, points + self._rise * normals])
        x, y, z = (0.5 * (points.min(axis=0) + points.max(axis=0))).tolist()
        width, height = self._size
        return Camera((x, y, z)).seeing(points, MARGIN, width / height)

    def _add_ghost(self, configuration: Configuration, options: Any) -> None:
        """Add a translucent copy of the robot to the scene that is rendered next."""
        import mujoco

        from mlivr_gym.simulation.scene import set_configuration

        data, scene = mujoco.MjData(self.model), self._renderer.scene
        set_configuration(self.model, data, *checked_configuration(self._robot, configuration))
        first, robot = scene.ngeom, mujoco.mjtCatBit.mjCAT_DYNAMIC
        mujoco.mjv_addGeoms(self.model, data, options, mujoco.MjvPerturb(), robot, scene)
        for geom in scene.geoms[first : scene.ngeom]:
            geom.rgba[3] *= GHOST_OPACITY
            geom.category = mujoco.mjtCatBit.mjCAT_DECOR  # which casts no shadow

    def close(self) -> None:
        """Release the GL context."""
        atexit.unregister(self._release)
        self._release()


class Shot(NamedTuple):
    """What a picture shows."""

    configuration: Configuration
    """Configuration of the robot."""
    captions: tuple[str, ...] = ()
    """Lines that are written below a picture that is large enough."""
    route: Route | None = None
    """Route of a plan."""
    ghosts: Sequence[Configuration] = ()
    """Configurations of translucent copies of the robot."""
    draw: Callable[[Any], None] | None = None
    """Function that adds shapes to the `mujoco.MjvScene`."""
    labels: Sequence[Label] = ()
    """Labels in addition to those of the route."""

    def picture(
        self, renderer: SceneRenderer, height: int, camera: Camera | None = None
    ) -> NDArray[np.uint8]:
        """Return the picture; `height` is its height with the captions [px]."""
        camera = camera or renderer.overview()
        image = renderer.render(
            *self.configuration, camera=camera, route=self.route, ghosts=self.ghosts, draw=self.draw
        )
        if self.labels:
            image = _labelled(image, camera, self.labels)
        for line in self.captions:
            image = with_caption(image, line, height)
        return image


def _labelled(
    image: NDArray[np.uint8], camera: Camera, labels: Sequence[Label]
) -> NDArray[np.uint8]:
    """Write labels on the picture of a camera."""
    positions = np.array([position for position, _, _ in labels]).reshape(-1, 3)
    pixels = camera.pixels(positions, image.shape[1], image.shape[0])
    return with_labels(image, pixels, [(text, colour) for _, text, colour in labels])


class SceneWindow:
    """Window of MuJoCo's viewer that shows configurations of a robot among `obstacles`."""

    @checked(ARGUMENTS)
    def __init__(
        self, grasp_map: GraspMap, robot: RobotSpec, obstacles: Sequence[Box] = ()
    ) -> None:
        """Open the window.

        Raises a `SceneError` if MuJoCo refuses the scene, and a `RenderError` if no window can be
        opened, for instance without a screen.
        """
        if sys.platform.startswith("linux") and not (
            os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        ):
            # Without this check the window library would end the whole process.
            raise RenderError(
                "render_mode='human' needs a screen, but DISPLAY is not set; "
                "use render_mode='rgb_array'"
            )
        from mlivr_gym.pictures.limb_meshes import show_limbs
        from mlivr_gym.simulation.scene import compile_spec, scene_spec  # isort: skip

        try:
            import mujoco
            import mujoco.viewer

            self.obstacles = tuple(obstacles)
            spec = scene_spec(grasp_map, robot, obstacles)
            show_limbs(spec, robot)
            self.model = compile_spec(spec)
            self.data = mujoco.MjData(self.model)
            self._viewer: Any = mujoco.viewer.launch_passive(self.model, self.data)
        except SceneError:
            raise
        except Exception as error:  # window systems raise errors of many kinds
            raise RenderError(
                f"MuJoCo's viewer cannot open a window ({type(error).__name__}: {error}); "
                f"without a screen, use render_mode='rgb_array'"
            ) from None

    def show(self, position: Array, quaternion: Array, joints: Array) -> None:
        """Show one configuration."""
        from mlivr_gym.simulation.scene import set_configuration

        set_configuration(self.model, self.data, position, quaternion, joints)
        self._viewer.sync()

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()
