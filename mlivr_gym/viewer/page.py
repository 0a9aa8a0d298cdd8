"""The page in the browser: what is drawn, and what stands in the panel, by name.

To draw a thing again under its name replaces it.
"""

from __future__ import annotations

import contextlib
import html
import io
import json
import logging
import re
import socket
from collections.abc import Callable, Sequence
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

    Attributes
    ----------
    server
        The server of viser.
    scene
        What it draws.
    gui
        Its panel.
    address
        Where a browser finds it.
    nodes
        What is drawn, by name.
    items
        What stands in the panel, by name.
    """

    def __init__(self, host: str, port: int, title: str) -> None:
        """Serve an empty page.

        Parameters
        ----------
        host
            Address of the network interface that answers.
        port
            Port; the next free one is taken where it is not.
        title
            Words above the panel, and on the browser's tab.

        Raises
        ------
        SettingError
            If there is no such interface.
        """
        try:
            socket.create_server((host, 0)).close()
        except OSError as error:
            raise SettingError(f"cannot serve on host {host!r}: {error.strerror}") from None
        # A browser that opens a connection beforehand and drops it would print a traceback.
        logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
        with _silence():
            self.server = viser.ViserServer(host=host, port=port, label=title, verbose=False)
        self.scene, self.gui = self.server.scene, self.server.gui
        self.gui.add_html(_TAB.format(html.escape(json.dumps(title))))
        self.address = f"http://{host}:{self.server.get_port()}"
        self.nodes: dict[str, Any] = {}
        self.items: dict[str, Any] = {}
        self.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        self.gui.main_panel.dock_right()
        self.scene.set_up_direction("+z")
        background = np.full((1, 1, 3), BACKGROUND, dtype=np.uint8)
        self.scene.set_background_image(background, format="png")
        self.scene.configure_environment_map(None)
        self.scene.configure_default_lights(False)
        self.scene.world_axes.visible = False

    def __contains__(self, name: str) -> bool:
        """Whether something is drawn under a name."""
        return name in self.nodes

    # What is drawn.

    def frame(self, name: str, **pose: Array) -> None:
        """Add a frame that draws nothing, for what is named below it; `position`, `wxyz`."""
        self.nodes[name] = self.scene.add_frame(f"/{name}", show_axes=False, **pose)

    def mesh(self, name: str, mesh: Mesh, colour: Colour, **pose: Array) -> None:
        """Draw a mesh, moved by a `position` [m]."""
        opacity = colour[3] if colour[3] < 1.0 else None
        self.nodes[name] = self.scene.add_mesh_simple(
            f"/{name}",
            mesh.vertices,
            mesh.faces,
            color=tuple(round(255 * part) for part in colour[:3]),
            opacity=opacity,
            side="double" if opacity else "front",
            cast_shadow=False,
            receive_shadow=False,
            **pose,
        )

    def label(self, name: str, text: str, position: Array) -> None:
        """Write words at a place [m], in front of everything."""
        self.nodes[name] = self.scene.add_label(
            f"/{name}", text, position=position, anchor="bottom-center", font_screen_scale=1.0
        )

    def gizmo(self, name: str, position: Array, done: Callable[[Array], None]) -> None:
        """Draw arrows to drag; `done` is called with the position [m] where they are dropped."""
        handle = self.scene.add_transform_controls(
            f"/{name}", scale=0.35, disable_rotations=True, disable_sliders=True,
            position=position, depth_test=False,
        )  # fmt: skip

        def dropped(event: Any) -> None:
            if event.phase == "end":
                done(np.array(event.target.position))

        handle.on_update(dropped)
        self.nodes[name] = handle

    def show(self, name: str, visible: bool) -> None:
        """Show or hide what is drawn, with all below it."""
        node = self.nodes.get(name)
        if node is not None and node.visible != visible:
            node.visible = visible

    def remove(self, name: str) -> None:
        """Remove what is drawn, if it is, with all below it."""
        found = [key for key in self.nodes if key == name or key.startswith(f"{name}/")]
        gone = {key: self.nodes.pop(key) for key in sorted(found)}
        for key, node in gone.items():
            if not any(key.startswith(f"{above}/") for above in gone):
                node.remove()

    def set_camera(self, position: Array, target: Array) -> None:
        """From where pages, those that are open too, see what [m]."""
        camera = self.server.initial_camera
        camera.up, camera.position, camera.look_at = (0.0, 0.0, 1.0), position, target
        camera.fov = np.deg2rad(FIELD_OF_VIEW)
        for client in self.server.get_clients().values():
            with client.atomic():
                client.camera.position, client.camera.look_at = position, target

    # What stands in the panel.

    def item(self, name: str, item: Any, called: Callable[[Any], None]) -> None:
        """Name what stands in the panel; `called` is given what people choose there.

        Values that the program sets call nobody.
        """

        def changed(event: Any) -> None:
            if event.client is not None:
                called(event.target.value)

        item.on_update(changed)
        self.items[name] = item

    def text(self, name: str, content: str = "") -> None:
        """Add words in Markdown."""
        self.items[name] = self.gui.add_markdown(content)

    def write(self, name: str, content: str) -> None:
        """Change words."""
        item = self.items[name]
        if item.content != content:
            item.content = content

    def set_curves(
        self, name: str, title: str, curves: Sequence[tuple[str, str]], highest: float
    ) -> None:
        """Give a plot curves of a label and a colour, whose data follow; without any it is hidden.

        Values are seen from 0 to `highest`.
        """
        item = self.items[name]
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

    # What is kept.

    def record(
        self, frames: Sequence[int], period: float, draw: Callable[[int], None], words: str
    ) -> str:
        """The page as one file that plays without a server.

        Parameters
        ----------
        frames
            What `draw` is called with, one after the other.
        period
            Time between two of them [s].
        draw
            Draws a frame.
        words
            Line that stands above the picture.
        """
        draw(frames[0])
        recorder = self.server.get_scene_serializer()
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
            self.server.stop()


def _silence() -> contextlib.redirect_stdout[io.StringIO]:
    """Keep the library from printing: the command says where the page is."""
    return contextlib.redirect_stdout(io.StringIO())
