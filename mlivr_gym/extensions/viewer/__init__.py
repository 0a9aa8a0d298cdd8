"""A viewer in the browser: plans and executions played, queries changed and planned anew."""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.viewer.live_plan import LivePlan, states_of
    from mlivr_gym.extensions.viewer.page import Page
    from mlivr_gym.extensions.viewer.viewer import Viewer, add_panel, write_html

__all__ = ["LivePlan", "Page", "Viewer", "add_panel", "states_of", "write_html"]

COMMANDS = {
    "view": (
        "show a plan in the browser and change it there",
        "mlivr-gym view --start D2a:4 D2b:4 --goal 6.0 0 0.42",
        "mlivr-gym view --plan plan.json --out walk.html",
    ),
}

__getattr__, __dir__ = lazy(__name__)
