"""The picture of a plan shows its path, its stances by number, the goal's ball and the robot."""

import numpy as np
import pytest
from matplotlib.colors import to_hex

from mlivr_gym.pictures import plan_figure as module
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR
from mlivr_gym.pictures.plan_figure import plan_figure


@pytest.fixture
def drawn(checked_graph, plan, monkeypatch, tmp_path):
    kept = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: kept.append(figure))
    tree = np.random.default_rng(0).uniform(1.0, 2.0, (7000, 2, 3))
    plan_figure(checked_graph.grasp_map, plan, tmp_path / "plan.png", tree, "Case 3")
    return kept[0]


def test_every_view_has_path_numbers_and_goal(drawn, plan):
    assert len(drawn.axes) == 3
    for axes in drawn.axes:
        numbers = [text.get_text() for text in axes.texts]
        assert numbers == [str(k) for k in range(len(plan.stances))]
        assert BASE_COLOUR in {to_hex(line.get_color()) for line in axes.lines}
        gold = [to_hex(c) for part in axes.collections for c in part.get_edgecolor()]
        gold += [to_hex(line.get_color()) for line in axes.lines]
        assert GOAL_COLOUR in gold


def test_flat_views_show_the_goal_in_its_size(drawn, plan):
    for axes, (across, up) in zip(drawn.axes[1:], ((0, 1), (0, 2)), strict=True):
        (ring,) = (line for line in axes.lines if to_hex(line.get_color()) == GOAL_COLOUR)
        off = ring.get_xydata() - [plan.query.goal[across], plan.query.goal[up]]
        np.testing.assert_allclose(np.linalg.norm(off, axis=1), plan.query.goal_tolerance)
        assert axes.get_aspect() == 1.0
