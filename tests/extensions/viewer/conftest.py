import pytest

from mlivr_gym.extensions.viewer.live_plan import LivePlan, query_of


@pytest.fixture
def live(checked_graph, walk):
    """A live plan; the world of the graph is put back."""
    yield LivePlan(checked_graph, query_of(checked_graph, walk), walk)
    checked_graph.remove_obstacles()
    checked_graph.vacate()


@pytest.fixture(scope="module")
def scenes_made_once():
    """Each scene is made once for the tests of a file, which only read it; it takes a second."""
    solids = pytest.importorskip(
        "mlivr_gym.extensions.viewer.drawing", reason="the extra 'viewer' is missing"
    )
    make, made = solids.scene_solids, {}

    def once(grasp_map, robot, *more):
        key = grasp_map.fingerprint, robot, *more
        if key not in made:
            made[key] = make(grasp_map, robot, *more)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mlivr_gym.extensions.viewer.drawing.scene_solids", once)
        yield


@pytest.fixture
def page(scenes_made_once):
    """A page on any free port."""
    pytest.importorskip("viser", reason="the extra 'viewer' is not installed")
    from mlivr_gym.extensions.viewer.page import Page

    page = Page("127.0.0.1", 0, "test")
    yield page
    page.close()


@pytest.fixture
def viewer(page, live):
    """A viewer with its panel, not playing."""
    from mlivr_gym.extensions.viewer.viewer import Viewer, add_panel

    viewer = Viewer(page, live)
    add_panel(viewer)
    return viewer
