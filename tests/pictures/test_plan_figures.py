"""The picture of a plan shows its path, its stances by number, the goal's ball and the robot."""

import numpy as np
import pytest
from matplotlib.colors import to_hex

from mlivr_gym.pictures import plan_figures as module
from mlivr_gym.pictures.figures import BASE_COLOUR, GOAL_COLOUR
from mlivr_gym.pictures.plan_figures import plan_figure
from mlivr_gym.pictures.route import plan_base_path


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


def test_paths_footholds_and_figures_are_those_of_the_plan(drawn, plan, jem):
    """In the flat views; the numbers of the plan in the line above them."""
    held = [[stance[limb] for stance in plan.stances] for limb in range(2)]
    for axes, view in zip(drawn.axes[1:], ([0, 1], [0, 2]), strict=True):
        (path,) = (line for line in axes.lines if to_hex(line.get_color()) == BASE_COLOUR)
        np.testing.assert_allclose(path.get_xydata(), plan_base_path(plan)[:, view])
        dots = {part.get_label(): np.array(part.get_offsets()) for part in axes.collections}
        for limb, points in enumerate(held):
            places = jem.positions[[jem.index(point) for point in points]][:, view]
            np.testing.assert_allclose(dots[f"footholds of limb {limb}"], places)
    told = " ".join(text.get_text() for text in drawn.texts)
    assert (
        f"{len(plan.steps)} steps, base translation {plan.base_translation:.2f} m, "
        f"minimum $w_m$ {plan.motion.w_m.min():.3f}, minimum $w_b$ {plan.motion.w_b.min():.4f}, "
        f"{plan.statistics.expanded} states expanded (2334 of 7000 drawn)"
    ) in told
