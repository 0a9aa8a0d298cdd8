"""Take the screenshot of the viewer in `docs/viewer.md`, with a plan around an occupied point.

    python experiments/viewer_picture.py [--out docs/pictures]

Needs the extras `viewer` and `docs` and an installed Chromium. Writes `viewer.png`.
"""

from __future__ import annotations

import shutil

from reports import GOAL, START, command_line

from mlivr_gym import stance_graph
from mlivr_gym.extensions.viewer import LivePlan, Page, Viewer, add_panel
from mlivr_gym.files import write_whole

SHOWN = 5.0
"""Time along the plan that the picture shows [s]."""

FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Options of Chromium for machines without a GPU."""

WIDTH, HEIGHT = 1440, 810
"""Size of the picture [px]."""

DRAWN = 8000
"""Time given to the page to draw everything [ms]."""


def main() -> None:
    """Serve the page and write its screenshot."""
    out = command_line(__doc__, out="docs/pictures").parse_args().out
    live = LivePlan(stance_graph(), {"start": START, "goal": GOAL, "cost": "steps"})
    live.replan()
    assert live.plan is not None
    live.toggle_occupied(live.plan.steps[0].to_point)
    viewer = Viewer(Page("127.0.0.1", 0, "mlivr-gym"), live)
    add_panel(viewer)
    viewer.seek(SHOWN)
    write_whole(out / "viewer.png", picture(viewer.page.address))
    viewer.close()


def picture(address: str) -> bytes:
    """Return a screenshot of a page once it is drawn."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=chromium, args=list(FLAGS))
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(address)
        page.locator(".mantine-Notification-closeButton").click()  # a warning about the missing GPU
        page.wait_for_timeout(DRAWN)
        taken: bytes = page.screenshot()
        browser.close()
    return taken


if __name__ == "__main__":
    main()
