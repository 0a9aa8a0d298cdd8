"""The page, without a browser."""

import pytest

from mlivr_gym.errors import SettingError
from mlivr_gym.viewer.solids import box_mesh

pytest.importorskip("viser", reason="the extra 'viewer' is not installed")

from mlivr_gym.viewer.page import Page


def test_another_page_takes_the_next_port(page):
    port = int(page.address.rsplit(":", 1)[1])
    other = Page("127.0.0.1", port, "other")
    assert other.address != page.address
    other.close()


def test_a_host_that_is_not_there_is_refused():
    with pytest.raises(SettingError, match=r"cannot serve on host '203\.0\.113\.7'"):
        Page("203.0.113.7", 0, "nowhere")


def test_nothing_is_printed(capsys):
    Page("127.0.0.1", 0, "quiet").close()
    assert capsys.readouterr().out == ""


def test_what_is_removed_takes_along_what_is_below(page):
    box = box_mesh((1.0, 1.0, 1.0))
    page.frame("a")
    page.mesh("a/b", box, (1.0, 0.0, 0.0, 1.0))
    page.mesh("ab", box, (1.0, 0.0, 0.0, 0.5))
    page.remove("a")
    assert ("a" in page, "a/b" in page, "ab" in page) == (False, False, True)
    page.remove("a")
    page.mesh("handles/a", box, (1.0, 0.0, 0.0, 1.0))
    handle = page.nodes["handles/a"]
    page.remove("handles")
    assert "handles/a" not in page
    assert handle._impl.removed  # from the scene, too
