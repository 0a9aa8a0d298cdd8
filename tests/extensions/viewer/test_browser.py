"""The page in a headless Chromium: what people see and do."""

import threading
import time

import numpy as np
import pytest
from chromium import chromium, opened

from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.rendering import MARGIN

pytest.importorskip("viser", reason="the extra 'viewer' is not installed")

from mlivr_gym.extensions.viewer import drawing
from mlivr_gym.extensions.viewer.viewer import ASPECT, write_html

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture
def shown(browser, viewer):
    """A page of the viewer, which plays; it must not have complained in the end."""
    playing = threading.Thread(target=viewer.run, daemon=True)
    playing.start()
    page, errors = opened(browser, viewer.page.address)
    page.get_by_text("4 steps, ").first.wait_for(timeout=0)
    until(lambda: page.locator("canvas").count() > 0)
    time.sleep(2.0)  # until all is drawn
    yield page
    page.close()
    viewer._closed.set()
    playing.join()
    assert errors == []


def until(true):
    """Wait, however long that takes; the limit of a test ends it."""
    while not true():
        time.sleep(0.1)


def pixel(viewer, page, place):
    """Where a place [m] is in the window of a page that was just opened [px]."""
    points = viewer.live.graph.grasp_map.positions
    middle = tuple((0.5 * (points.min(axis=0) + points.max(axis=0))).tolist())
    camera = Camera(middle, azimuth=drawing.AZIMUTH, elevation=drawing.ELEVATION)
    box = page.locator("canvas").first.bounding_box()
    camera = camera.seeing(points, MARGIN, ASPECT)
    ((x, y),) = camera.pixels(np.array([place]), box["width"], box["height"])
    return box["x"] + x, box["y"] + y


def click_on_point(viewer, page, point):
    grasp_map = viewer.live.graph.grasp_map
    page.mouse.click(*pixel(viewer, page, grasp_map.positions[grasp_map.index(point)]))


def choose(page, label, value):
    page.get_by_role("combobox", name=label).click()
    page.get_by_role("option", name=value, exact=True).click()


def scrubber(page):
    return float(page.get_by_role("slider").first.get_attribute("aria-valuenow"))


def test_a_plan_plays_and_pauses(shown, viewer):
    assert scrubber(shown) == 0.0
    shown.get_by_role("button", name="Play or pause", exact=True).click()
    until(lambda: scrubber(shown) > 0.5)
    until(lambda: viewer.page.nodes["now"].text.startswith("step 1 of 4"))
    shown.get_by_role("button", name="Play or pause", exact=True).click()
    until(lambda: not viewer.playing)
    time.sleep(1.0)
    paused = scrubber(shown)
    time.sleep(1.0)
    assert scrubber(shown) == paused == pytest.approx(viewer.time, abs=0.02)


def test_a_blocked_point_is_planned_round(shown, viewer, walk):
    """The numbers on the page change, and the plan does not use the point any more."""
    point = walk.steps[0].to_point
    before = shown.get_by_text("4 steps, ").first.inner_text()
    choose(shown, "a click on a point", "block or free it")
    until(lambda: viewer.click == "block or free it")
    click_on_point(viewer, shown, point)
    until(lambda: shown.get_by_text(before).count() == 0)
    assert viewer.live.graph.ids(sorted(viewer.live.graph.occupied)) == (point,)
    assert point not in {step.to_point for step in viewer.live.plan.steps}
    now = shown.locator("strong").first.inner_text()
    assert now != before
    assert now == f"{len(viewer.live.plan.steps)} steps, {viewer.live.plan.base_translation:.3f} m"


def test_a_goal_that_is_dragged_is_planned_to(shown, viewer):
    """Its red arrow points along x, to the right in the picture."""
    goal = viewer.live.goal
    x, y = pixel(viewer, shown, goal + np.array([0.2, 0.0, 0.0]))
    to, _ = pixel(viewer, shown, goal - np.array([0.6, 0.0, 0.0]))
    shown.mouse.move(x, y)
    time.sleep(0.5)
    shown.mouse.down()
    for share in np.linspace(0.0, 1.0, 8):
        shown.mouse.move(x + share * (to - x), y)
        time.sleep(0.1)
    shown.mouse.up()
    until(lambda: viewer.live.goal[0] < 5.7)
    np.testing.assert_allclose(viewer.live.goal[1:], goal[1:], atol=1e-6)
    until(lambda: viewer.live.plan is not None)
    shown.get_by_text(f"({viewer.live.goal[0]:.2f}, 0.00, 0.42)").wait_for(timeout=0)


def test_a_file_plays_without_a_server(browser, checked_graph, walk, tmp_path):
    write_html(tmp_path / "walk.html", checked_graph, walk)
    page, errors = opened(browser, (tmp_path / "walk.html").as_uri())
    times = page.locator("input").first
    times.wait_for(timeout=0)
    first = float(times.input_value())
    until(lambda: float(times.input_value()) > first + 0.5)
    page.close()
    assert errors == []
