import pytest

from mlivr_gym.viewer.live_plan import LivePlan, LiveQuery


@pytest.fixture
def live(checked_graph, walk):
    """A live plan; the world of the graph is put back."""
    yield LivePlan(checked_graph, LiveQuery.of_plan(checked_graph, walk), walk)
    checked_graph.remove_obstacles()
    checked_graph.vacate()


@pytest.fixture
def page():
    """A page on any free port."""
    pytest.importorskip("viser", reason="the extra 'viewer' is not installed")
    from mlivr_gym.viewer.page import Page

    page = Page("127.0.0.1", 0, "test")
    yield page
    page.close()


@pytest.fixture
def viewer(page, live):
    """A viewer with its panel, not playing."""
    from mlivr_gym.viewer.panel import add_panel
    from mlivr_gym.viewer.viewer import Viewer

    viewer = Viewer(page, live)
    add_panel(viewer)
    viewer.refresh()
    return viewer
