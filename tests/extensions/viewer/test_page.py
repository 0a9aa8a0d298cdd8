"""The page, without a browser."""

import socket
from http.client import HTTPConnection

import pytest

from mlivr_gym.errors import SettingError

pytest.importorskip("viser", reason="the extra 'viewer' is not installed")

import trimesh

from mlivr_gym.extensions.viewer.page import Page


def test_a_host_that_is_not_there_is_refused():
    with pytest.raises(SettingError, match=r"cannot serve on host '203\.0\.113\.7'"):
        Page("203.0.113.7", 0, "nowhere")


def test_a_page_is_served_at_its_address_alone(page):
    """And at no other of this computer, such as those of the same loop on Linux."""
    port = int(page.address.rsplit(":", 1)[1])
    for address, is_served in (("127.0.0.1", True), ("127.0.0.2", False)):
        with socket.socket() as other:
            other.settimeout(5.0)
            assert (other.connect_ex((address, port)) == 0) == is_served


def test_nothing_is_printed(capsys):
    Page("127.0.0.1", 0, "quiet").close()
    assert capsys.readouterr().out == ""


def test_what_is_removed_takes_along_what_is_below(page):
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    page.clear("a")
    page.mesh("a/b", box, (1.0, 0.0, 0.0, 1.0))
    page.mesh("ab", box, (1.0, 0.0, 0.0, 0.5))
    page.remove("a")
    assert ("a" in page.nodes, "a/b" in page.nodes, "ab" in page.nodes) == (False, False, True)
    page.remove("a")
    page.clear("handles")
    page.mesh("handles/a", box, (1.0, 0.0, 0.0, 1.0))
    handle = page.nodes["handles/a"]
    page.remove("handles")
    assert "handles/a" not in page.nodes
    assert handle._impl.removed  # from the scene, too


def answer(page, path="/", **headers):
    """The status with which the server of a page answers a request."""
    host, port = page.address.removeprefix("http://").split(":")
    given = {"Host": f"{host}:{port}"} | {name.replace("_", "-"): v for name, v in headers.items()}
    connection = HTTPConnection(host, int(port), timeout=30.0)
    connection.request("GET", path, headers=given)
    status = connection.getresponse().status
    connection.close()
    return status


def test_pages_of_other_sites_in_the_same_browser_are_refused(page):
    """They could change the query, or have the library publish the page."""
    port, key = page.address.rsplit(":", 1)[1], "dGhlIHNhbXBsZSBub25jZQ=="
    upgrade = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec_WebSocket_Key": key}
    upgrade |= {"Sec_WebSocket_Version": "13"}
    for more, whole in (({}, 200), (upgrade, 101)):
        assert answer(page, **more) == whole  # a program that is no browser names no origin
        assert answer(page, **more, Origin=page.address) == whole
        local = f"localhost:{port}"
        assert answer(page, **more, Host=local, Origin=f"http://{local}") == whole
        origins = "http://evil.example", "null", "http://127.0.0.1:1", f"http://{local}"
        alike = f"{page.address}0", f"{page.address}.evil.example"
        alike += f"http://evil.{page.address[7:]}", f"https://{page.address[7:]}"
        for origin in (*origins, *alike):
            assert answer(page, **more, Origin=origin) == 403
        # A name of the other site that is made to lead here (DNS rebinding).
        for evil in (f"evil.example:{port}", f"127.0.0.1.evil.example:{port}"):
            assert answer(page, **more, Host=evil, Origin=f"http://{evil}") == 403
            assert answer(page, **more, Host=evil) == 403


def test_a_name_that_is_given_as_host_is_answered(scenes_made_once):
    name = Page("localhost", 0, "named")
    assert answer(name, Origin=name.address) == 200
    name.close()
