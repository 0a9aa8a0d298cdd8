"""The picture of a walk among obstacles tells plans apart."""

import numpy as np
import pytest
from matplotlib.colors import to_hex

from mlivr_gym import Box
from mlivr_gym.pictures import plan_figures as module
from mlivr_gym.pictures.figures import BASE_COLOUR
from mlivr_gym.pictures.map_views import FROM_ABOVE, FROM_THE_SIDE, IN_SPACE
from mlivr_gym.pictures.plan_figures import BOX_COLOUR, parts_of
from mlivr_gym.pictures.route import plan_base_path
from mlivr_gym.planners import Planner

BOX = Box.between("cargo", "obstacle", (3.0, -0.2, -0.2), (3.4, 0.2, 0.2))


@pytest.fixture
def drawn(graph, monkeypatch, tmp_path):
    """Two plans, the first abandoned after a step."""
    planner, kept = Planner(graph), []
    first = planner.plan(("D2a:4", "D1b:3"), (6.3, 0.5, 0.35), "steps").unwrap()
    second = planner.plan(first.stances[1], (6.3, 0.5, 0.35), "base").unwrap()
    walked = [(first, 1), (second, len(second.steps))]
    monkeypatch.setattr(module, "save_figure", lambda figure, path: kept.append(figure))
    module.walk_figure(graph.grasp_map, walked, tmp_path / "walk.png", [BOX])
    return kept[0], first, second


def path_of(axes):
    """The thick green line of a view."""
    (path,) = (line for line in axes.lines if to_hex(line.get_color()) == BASE_COLOUR)
    return np.array(path.get_data_3d() if axes.name == "3d" else path.get_data()).T


def test_every_view_has_the_path_that_was_walked(drawn):
    figure, first, second = drawn
    walked = np.vstack([parts_of(first, 1)[0], plan_base_path(second)])
    stances = np.vstack([first.motion.base_positions[:2], second.motion.base_positions[1:]])
    for axes, view in zip(figure.axes, (IN_SPACE, FROM_ABOVE, FROM_THE_SIDE), strict=True):
        np.testing.assert_allclose(path_of(axes), walked[:, view])
        assert len(axes.texts) - (view == IN_SPACE) == len(stances)  # and the name of the box
    length = np.linalg.norm(np.diff(stances, axis=0), axis=1).sum()
    told = [text.get_text() for text in figure.texts]
    assert f"{len(stances) - 1} steps, base translation {length:.2f} m" in told


def test_flat_views_show_where_the_box_is(drawn):
    for axes, view in zip(drawn[0].axes[1:], (FROM_ABOVE, FROM_THE_SIDE), strict=True):
        (box,) = (patch for patch in axes.patches if to_hex(patch.get_facecolor()) == BOX_COLOUR)
        np.testing.assert_allclose(np.ptp(box.get_xy(), axis=0), [0.4, 0.4])
        np.testing.assert_allclose(box.get_xy().min(axis=0), BOX.bounds[0][list(view)])


def test_what_was_walked_and_what_was_given_up_make_the_whole_way(drawn):
    """Sample by sample."""
    plan = drawn[1]
    whole = plan_base_path(plan)
    assert len(plan.steps) > 1
    for taken in range(len(plan.steps) + 1):
        walked, abandoned = parts_of(plan, taken)
        np.testing.assert_allclose(np.vstack([walked, abandoned[1:]]), whole, atol=1e-12)
