"""The picture of a reach: each point once, to scale, coloured by its steps."""

import numpy as np
from matplotlib import colormaps

from mlivr_gym.pictures import reach_figure as module
from mlivr_gym.pictures.reach_figure import COLOURS, panels_of, reach_figure
from mlivr_gym.planners.reach import Reach


def test_every_point_is_drawn_in_one_panel_at_the_same_scale(jem, monkeypatch, tmp_path):
    figures = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: figures.append(figure))
    steps = np.random.default_rng(0).integers(-1, 4, len(jem))
    reach = Reach((jem.ids[0], jem.ids[1]), steps, 9, True)
    reach_figure(jem, reach, tmp_path / "reach.png", "Reach")
    panels = panels_of(jem)
    assert sorted(np.concatenate([points for _, points in panels.values()])) == [*range(len(jem))]
    scales, width = [], figures[0].get_size_inches()[0]
    for axes, (view, points) in zip(figures[0].axes, panels.values(), strict=True):
        found, missed = axes.collections[:2]
        at = jem.positions[points][:, view]
        np.testing.assert_allclose(found.get_offsets(), at[steps[points] >= 0])
        np.testing.assert_allclose(missed.get_offsets(), at[steps[points] < 0])
        shown = colormaps[COLOURS](steps[points][steps[points] >= 0] / 3.0)
        np.testing.assert_allclose(found.get_facecolor(), shown)
        assert axes.get_aspect() == 1.0
        scales.append(axes.get_position().width * width / np.ptp(axes.get_xlim()))
        rows = {jem.faces[p] for p in points}
        assert all(face in axes.get_title(loc="left") for face in rows)
    np.testing.assert_allclose(scales, scales[0])
