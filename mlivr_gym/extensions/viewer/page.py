"""The page in the browser: nodes of the scene and items of the panel, each with a name.

Drawing under a name that exists replaces the earlier node.
"""

from __future__ import annotations

import contextlib
import io
import logging
import socket
from collections.abc import Callable, Iterator
from http import HTTPStatus
from ipaddress import ip_address
from typing import Any

import numpy as np
import trimesh
import viser
import websockets.asyncio.server as websocket_server

from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, from 0 to 1."""

BACKGROUND = (238, 241, 245)
"""Colour of the background, red, green and blue up to 255."""

END = 1.5
"""Time for which an exported page stays at its end before it starts again [s]."""


class Page:
    """A page of viser that is served at `address` until it is closed.

    `nodes` are those of its scene, and `items` those of its panel, by name.
    """

    def __init__(self, host: str, port: int, title: str) -> None:
        """Serve an empty page with a title, which the panel has.

        It has the address `host` of the server's network interface, and a port, or the next free
        one if it is taken; 0 for any free port. Raises a `SettingError` if this computer has no
        such interface.
        """
        try:
            socket.create_server((host, 0)).close()
        except OSError as error:
            raise SettingError(
                f"cannot serve on host {host!r}: {error.strerror}; "
                "it must be an address of this computer, such as 127.0.0.1"
            ) from None
        # Otherwise a browser that opens a connection and drops it would cause a traceback.
        logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
        with _silence(), _same_origin_only(host):
            self.server = viser.ViserServer(host=host, port=port, label=title, verbose=False)
        self.scene, self.gui = self.server.scene, self.server.gui
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

    def clear(self, name: str) -> None:
        """Make a node an invisible parent without descendants."""
        self.remove(name)
        self.nodes[name] = self.scene.add_frame(f"/{name}", show_axes=False)

    def mesh(self, name: str, mesh: trimesh.Trimesh, colour: Colour) -> None:
        """Draw a mesh with the edges that are sharp."""
        mesh = trimesh.graph.smooth_shade(mesh, angle=0.25 * np.pi)
        self.nodes[name] = self.scene.add_mesh_simple(
            f"/{name}", mesh.vertices, mesh.faces, **_looks(colour)
        )

    def ball(self, name: str, position: Array, radius: float, colour: Colour) -> None:
        """Draw a ball about a position [m]."""
        self.nodes[name] = self.scene.add_icosphere(
            f"/{name}", radius, position=position, **_looks(colour)
        )

    def line(self, name: str, positions: Array, colour: Colour, thickness: float) -> None:
        """Draw a polyline, shape (k, 3) [m], of a thickness [m]; nothing if it has no length."""
        pieces = np.stack([positions[:-1], positions[1:]], axis=1)
        if len(pieces):
            self.nodes[name] = self.scene.add_line_segments(
                f"/{name}", pieces, _looks(colour)["color"], thickness=thickness
            )

    def label(self, name: str, text: str, position: Array) -> None:
        """Write a text at a position [m], in front of everything else."""
        self.nodes[name] = self.scene.add_label(
            f"/{name}", text, position=position, anchor="bottom-center", font_screen_scale=1.0
        )

    def gizmo(self, name: str, position: Array, on_drop: Callable[[Array], None]) -> None:
        """Draw arrows that can be dragged; `on_drop` is called with their new position [m]."""
        handle = self.scene.add_transform_controls(
            f"/{name}", scale=0.35, disable_rotations=True, disable_sliders=True,
            position=position, depth_test=False,
        )  # fmt: skip

        def dropped(event: Any) -> None:
            if event.phase == "end":
                on_drop(np.array(event.target.position))

        handle.on_update(dropped)
        self.nodes[name] = handle

    def show(self, name: str, visible: bool) -> None:
        """Show or hide a node with its descendants."""
        if self.nodes[name].visible != visible:
            self.nodes[name].visible = visible

    def remove(self, name: str) -> None:
        """Remove a node, if it exists, with its descendants."""
        if name in self.nodes:
            self.nodes[name].remove()
            below = [key for key in self.nodes if key == name or key.startswith(f"{name}/")]
            for key in below:
                del self.nodes[key]

    def item(self, name: str, item: Any, on_change: Callable[[Any], None]) -> None:
        """Name an item of the panel; `on_change` is called with the values that users choose.

        It is not called for values that the program sets.
        """

        def changed(event: Any) -> None:
            if event.client is not None:
                on_change(event.target.value)

        item.on_update(changed)
        self.items[name] = item

    def write(self, name: str, content: str) -> None:
        """Change a text, if the page has a panel with it."""
        item = self.items.get(name)
        if item is not None and item.content != content:
            item.content = content

    def record(self, times: Array, period: float, draw: Callable[[float], None]) -> str:
        """Return the page as HTML that plays without a server.

        `draw` is called with each of the times in order; the pictures are `period` apart [s].
        """
        draw(float(times[0]))
        recorder = self.server.get_scene_serializer()
        for time in times[1:].tolist():
            recorder.insert_sleep(period)
            draw(time)
        recorder.insert_sleep(END)
        return str(recorder.as_html())

    def close(self) -> None:
        """Stop the server."""
        with _silence():
            self.server.stop()


def _looks(colour: Colour) -> dict[str, Any]:
    """Return colour and opacity as arguments of the library; nothing casts a shadow."""
    r, g, b, opacity = colour
    return {
        "color": (round(255 * r), round(255 * g), round(255 * b)),
        "opacity": opacity if opacity < 1.0 else None,
        "side": "double" if opacity < 1.0 else "front",
        "cast_shadow": False,
        "receive_shadow": False,
    }


@contextlib.contextmanager
def _same_origin_only(host: str) -> Iterator[None]:
    """Let servers that are started in the block refuse the pages of other sites.

    Any page in the same browser can send requests to this computer. Its browser tells its origin,
    which must be this server; and a name of another site, which may be made to lead here (DNS
    rebinding), is none of this server. The library has no option for it.
    """
    serve, names = websocket_server.serve, {host, "localhost", socket.gethostname()}

    def checked(*args: Any, process_request: Any, **options: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            asked = request.headers.get("Host", "")
            origin = request.headers.get("Origin", f"http://{asked}")
            name = asked.rsplit(":", 1)[0]
            if origin != f"http://{asked}" or not (name in names or _is_address(name)):
                return connection.respond(HTTPStatus.FORBIDDEN, "another site\n")
            return process_request(connection, request)

        return serve(*args, process_request=answer, **options)

    websocket_server.serve = checked  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websocket_server.serve = serve  # type: ignore[misc]


def _is_address(name: str) -> bool:
    """Return whether the name of a host is an IP address, which no other site can have."""
    try:
        ip_address(name.strip("[]"))
    except ValueError:
        return False
    return True


def _silence() -> contextlib.redirect_stdout[io.StringIO]:
    """Suppress the output of the library; the command itself prints the address."""
    return contextlib.redirect_stdout(io.StringIO())
