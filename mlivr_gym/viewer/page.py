"""The page in the browser: the one module that knows the library that serves it.

What is drawn, and what stands in the panel, is addressed by name, so that the rest of the viewer
passes names, numbers and arrays. To draw a thing again under its name replaces it.
"""

from __future__ import annotations

import contextlib
import html
import io
import json
import logging
import re
import socket
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import viser
import viser.uplot

from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError
from mlivr_gym.pictures.camera import FIELD_OF_VIEW
from mlivr_gym.viewer.solids import Colour, Mesh

BACKGROUND = (238, 241, 245)
"""Colour behind the module, red, green and blue up to 255."""

_TAB = '<img src="data:," alt="" style="display:none" onerror="document.title={}">'
# The library has no name for the browser's tab: an image that is none sets it when it is drawn.

END = 1.5
"""How long a file that plays stays at its end before it begins again [s]."""


class Page:
    """A page that is served until it is closed.

    Attributes:
        address: Where a browser finds it.
    """

    def __init__(self, host: str, port: int, title: str) -> None:
        """Serve an empty page.

        Args:
            host: Address of the network interface that answers.
            port: Port; the next free one is taken where it is not.
            title: Words above the panel, and on the browser's tab.

        Raises:
            SettingError: If there is no such interface.
        """
        try:
            socket.create_server((host, 0)).close()
        except OSError as error:
            raise SettingError(f"cannot serve on host {host!r}: {error.strerror}") from None
        # A browser that opens a connection beforehand and drops it would print a traceback.
        logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
        with _silence():
            self._server = viser.ViserServer(host=host, port=port, label=title, verbose=False)
        self._server.gui.add_html(_TAB.format(html.escape(json.dumps(title))))
        self.address = f"http://{host}:{self._server.get_port()}"
        self._nodes: dict[str, Any] = {}
        self._items: dict[str, Any] = {}
        gui, scene = self._server.gui, self._server.scene
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.main_panel.dock_right()
        scene.set_up_direction("+z")
        scene.set_background_image(np.full((1, 1, 3), BACKGROUND, dtype=np.uint8), format="png")
        scene.configure_environment_map(None)
        scene.configure_default_lights(False)
        scene.world_axes.visible = False

    def __contains__(self, name: str) -> bool:
        """Whether something is drawn under a name."""
        return name in self._nodes

    # What is drawn.

    def light(self, name: str, intensity: float, position: Array | None = None) -> None:
        """Add a lamp at a position, towards the origin and from afar, or light from everywhere."""
        scene = self._server.scene
        if position is None:
            self._nodes[name] = scene.add_light_ambient(f"/{name}", intensity=intensity)
        else:
            self._nodes[name] = scene.add_light_directional(
                f"/{name}", intensity=intensity, position=position, cast_shadow=False
            )

    def frame(self, name: str, position: Array, quaternion: Array) -> None:
        """Add a frame that draws nothing, for what is named below it."""
        self._nodes[name] = self._server.scene.add_frame(
            f"/{name}", show_axes=False, position=position, wxyz=quaternion
        )

    def mesh(self, name: str, mesh: Mesh, colour: Colour, *, position: Array | None = None) -> None:
        """Draw a mesh, moved by a position [m]."""
        opacity = colour[3] if colour[3] < 1.0 else None
        self._nodes[name] = self._server.scene.add_mesh_simple(
            f"/{name}",
            mesh.vertices,
            mesh.triangles,
            color=tuple(round(255 * part) for part in colour[:3]),
            opacity=opacity,
            side="double" if opacity else "front",
            cast_shadow=False,
            receive_shadow=False,
            position=np.zeros(3) if position is None else position,
        )

    def copies(
        self, name: str, mesh: Mesh, positions: Array, quaternions: Array, colours: Array
    ) -> None:
        """Draw a mesh at many places.

        Args:
            name: Its name.
            mesh: The mesh.
            positions: Where, shape (k, 3) [m].
            quaternions: Turned how, w, x, y, z, shape (k, 4).
            colours: Red, green and blue up to 255, shape (k, 3).
        """
        self._nodes[name] = self._server.scene.add_batched_meshes_simple(
            f"/{name}",
            mesh.vertices,
            mesh.triangles,
            quaternions,
            positions,
            batched_colors=_linear(colours),
            batched_scales=np.ones(len(positions), dtype=np.float32),
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

    def recolour(self, name: str, colours: Array, scales: Array) -> None:
        """Give copies other colours, shape (k, 3), and sizes as multiples of the mesh, (k,)."""
        node = self._nodes[name]
        node.batched_colors = _linear(colours)
        node.batched_scales = np.asarray(scales, dtype=np.float32)

    def lines(self, name: str, segments: Array, colour: Colour, width: float) -> None:
        """Draw line segments, shape (k, 2, 3) [m], `width` metres wide; none removes them."""
        if not len(segments):
            self.remove(name)
            return
        self._nodes[name] = self._server.scene.add_line_segments(
            f"/{name}", segments, tuple(round(255 * part) for part in colour[:3]), thickness=width
        )

    def label(self, name: str, text: str, position: Array, size: float = 1.0) -> None:
        """Write words at a place [m], in front of everything."""
        self._nodes[name] = self._server.scene.add_label(
            f"/{name}", text, position=position, anchor="bottom-center", font_screen_scale=size
        )

    def relabel(self, name: str, text: str, position: Array) -> None:
        """Change words and where they stand [m]."""
        node = self._nodes[name]
        node.position = position
        if node.text != text:
            node.text = text

    def gizmo(
        self, name: str, position: Array, done: Callable[[Array], None], size: float = 0.35
    ) -> None:
        """Draw arrows to drag; `done` is called with the position [m] where they are dropped."""
        handle = self._server.scene.add_transform_controls(
            f"/{name}",
            scale=size,
            disable_rotations=True,
            disable_sliders=True,
            position=position,
            depth_test=False,
        )

        def dropped(event: Any) -> None:
            if event.phase == "end":
                done(np.array(event.target.position))

        handle.on_update(dropped)
        self._nodes[name] = handle

    def move(self, name: str, position: Array) -> None:
        """Move what is drawn [m]."""
        self._nodes[name].position = position

    def turn(self, name: str, quaternion: Array) -> None:
        """Turn what is drawn, w, x, y, z."""
        self._nodes[name].wxyz = quaternion

    def show(self, name: str, visible: bool) -> None:
        """Show or hide what is drawn, with all below it."""
        node = self._nodes.get(name)
        if node is not None and node.visible != visible:
            node.visible = visible

    def remove(self, name: str) -> None:
        """Remove what is drawn, if it is, with all below it."""
        found = [key for key in self._nodes if key == name or key.startswith(f"{name}/")]
        gone = {key: self._nodes.pop(key) for key in sorted(found)}
        for key, node in gone.items():
            if not any(key.startswith(f"{above}/") for above in gone):
                node.remove()

    def on_click(self, name: str, called: Callable[[Array, Array], None]) -> None:
        """Call with origin [m] and direction of the line of sight when something is clicked."""
        self._nodes[name].on_click(
            lambda event: called(np.array(event.ray_origin), np.array(event.ray_direction))
        )

    def look(self, position: Array, target: Array) -> None:
        """From where pages, those that are open too, see what [m]."""
        camera = self._server.initial_camera
        camera.up, camera.position, camera.look_at = (0.0, 0.0, 1.0), position, target
        camera.fov = np.deg2rad(FIELD_OF_VIEW)
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.position, client.camera.look_at = position, target

    def on_camera(self, called: Callable[[Array], None]) -> None:
        """Call with the position [m] of a camera that moves."""

        def watch(client: Any) -> None:
            client.camera.on_update(lambda camera: called(np.array(camera.position)))

        self._server.on_client_connect(watch)

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Let a page see what is changed inside at once."""
        with self._server.atomic():
            yield

    # What stands in the panel.

    @contextlib.contextmanager
    def folder(self, title: str, *, opened: bool = True) -> Iterator[None]:
        """Put what is added inside below a title."""
        with self._server.gui.add_folder(title, expand_by_default=opened):
            yield

    def text(self, name: str, content: str = "") -> None:
        """Add words in Markdown."""
        self._items[name] = self._server.gui.add_markdown(content)

    def write(self, name: str, content: str) -> None:
        """Change words."""
        item = self._items[name]
        if item.content != content:
            item.content = content

    def button(self, name: str, label: str, called: Callable[[], None], hint: str = "") -> None:
        """Add a button."""
        item = self._server.gui.add_button(label, hint=hint or None)
        item.on_click(lambda _: called())
        self._items[name] = item

    def buttons(self, name: str, labels: Sequence[str], called: Callable[[str], None]) -> None:
        """Add a row of buttons; `called` is told the label."""
        item = self._server.gui.add_button_group("", labels)
        item.on_click(lambda event: called(str(event.target.value)))
        self._items[name] = item

    def checkbox(
        self, name: str, label: str, value: bool, called: Callable[[bool], None], hint: str = ""
    ) -> None:
        """Add a switch."""
        item = self._server.gui.add_checkbox(label, value, hint=hint or None)
        self._called_by_people(name, item, called)

    def choice(
        self,
        name: str,
        label: str,
        values: Sequence[str],
        value: str,
        called: Callable[[str], None],
    ) -> None:
        """Add a choice."""
        item = self._server.gui.add_dropdown(label, values, initial_value=value)
        self._called_by_people(name, item, called)

    def number(
        self, name: str, label: str, value: float, most: float, called: Callable[[float], None]
    ) -> None:
        """Add a number from 0 on."""
        item = self._server.gui.add_number(label, value, min=0.0, max=most, step=0.01)
        self._called_by_people(name, item, called)

    def slider(
        self, name: str, label: str, most: float, step: float, called: Callable[[float], None]
    ) -> None:
        """Add a slider from 0 on."""
        item = self._server.gui.add_slider(label, 0.0, most, step, 0.0)
        self._called_by_people(name, item, called)

    def stretch(self, name: str, most: float) -> None:
        """Let a slider go up to another number."""
        self._items[name].max = most

    def plot(self, name: str, height: int = 150) -> None:
        """Add a plot, which is hidden until it has curves."""
        data = (np.zeros(2), np.zeros(2))
        self._items[name] = self._server.gui.add_uplot(data, ({}, {}), height=height, visible=False)

    def set_curves(
        self, name: str, title: str, curves: Sequence[tuple[str, str]], highest: float
    ) -> None:
        """Give a plot curves, whose data follow; without any it is hidden.

        Args:
            name: The plot.
            title: What it shows.
            curves: Label and colour of each.
            highest: Largest value that is seen; the least is 0.
        """
        item = self._items[name]
        item.visible = bool(curves)
        series: list[viser.uplot.Series] = [{"label": "s"}]
        for label, colour in curves:
            series.append(
                {"label": label, "stroke": colour, "width": 1.5, "points": {"show": False}}
            )
        item.title, item.series = title, tuple(series)
        item.data = tuple(np.zeros(2) for _ in series)
        item.axes = ({}, {"size": 45})
        item.scales = {"x": {"time": False}, "y": {"range": (0.0, highest)}}
        item.legend = {"live": False}

    def set_data(self, name: str, times: Array, values: Sequence[Array]) -> None:
        """Give the curves of a plot their values, shape (k,), NaN where there is none."""
        self._items[name].data = (times, *values)

    def set(self, name: str, value: Any) -> None:
        """Set a value in the panel; nobody is called."""
        self._items[name].value = value

    def enable(self, name: str, enabled: bool) -> None:
        """Let something in the panel be used, or not."""
        self._items[name].disabled = not enabled

    def _called_by_people(self, name: str, item: Any, called: Callable[[Any], None]) -> None:
        """Pass changes on that come from a page, not those of `set`."""

        def changed(event: Any) -> None:
            if event.client is not None:
                called(event.target.value)

        item.on_update(changed)
        self._items[name] = item

    # What is kept.

    def recorded(
        self, frames: Sequence[int], period: float, draw: Callable[[int], None], words: str
    ) -> str:
        """The page as one file that plays without a server.

        Args:
            frames: What `draw` is called with, one after the other.
            period: Time between two of them [s].
            draw: Draws a frame.
            words: Line that stands above the picture.
        """
        draw(frames[0])
        recorder = self._server.get_scene_serializer()
        for frame in frames[1:]:
            recorder.insert_sleep(period)
            draw(frame)
        recorder.insert_sleep(END)
        page: str = recorder.as_html()
        line = (
            '<div style="position:fixed;top:0.7em;left:1em;z-index:5;font:15px sans-serif;'
            f'color:#333;pointer-events:none">{html.escape(words)}</div>'
        )
        page = re.sub("<title>.*?</title>", f"<title>{html.escape(words)}</title>", page, count=1)
        return page.replace("<body>", f"<body>{line}", 1)

    def close(self) -> None:
        """Serve no longer."""
        with _silence():
            self._server.stop()


def _linear(colours: Array) -> Any:
    """Colours of copies as the library takes them: linear in brightness, unlike all others."""
    share = np.asarray(colours, dtype=np.float64) / 255.0
    dark = share / 12.92
    return np.round(
        255.0 * np.where(share <= 0.04045, dark, ((share + 0.055) / 1.055) ** 2.4)
    ).astype(np.uint8)


def _silence() -> contextlib.redirect_stdout[io.StringIO]:
    """Keep the library from printing: the command says where the page is."""
    return contextlib.redirect_stdout(io.StringIO())
