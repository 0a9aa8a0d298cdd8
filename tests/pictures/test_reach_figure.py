"""The picture of a reach: each point once, to scale, coloured by its steps."""

import numpy as np
from matplotlib import colormaps

from mlivr_gym.pictures import reach_figure as module
from mlivr_gym.pictures.reach_figure import COLOURS, map_panels, reach_figure
from mlivr_gym.planners.reach import Reach


def test_every_point_is_drawn_in_one_panel_at_the_same_scale(jem, monkeypatch, tmp_path):
    figures = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: figures.append(figure))
    steps = np.random.default_rng(0).integers(-1, 4, len(jem))
    reach = Reach((jem.ids[0], jem.ids[1]), steps, 9, True)
    reach_figure(jem, reach, tmp_path / "reach.png", "Reach")
    panels = map_panels(jem)[1]
    assert sorted(np.concatenate([points for _, points, _ in panels])) == [*range(len(jem))]
    scales, width = [], figures[0].get_size_inches()[0]
    for axes, (_, points, flat) in zip(figures[0].axes, panels, strict=True):
        *found, missed = axes.collections[:5]
        for k, dots in enumerate(found):
            np.testing.assert_allclose(dots.get_offsets(), flat[steps[points] == k])
            np.testing.assert_allclose(dots.get_facecolor(), [colormaps[COLOURS](k / 3.0)])
        np.testing.assert_allclose(missed.get_offsets(), flat[steps[points] < 0])
        right, up = ("xyz".index(label[0]) for label in (axes.get_xlabel(), axes.get_ylabel()))
        np.testing.assert_allclose(flat, jem.positions[points][:, [right, up]])
        (main,) = {0, 1, 2} - {right, up}
        assert (np.abs(jem.normals[points]).argmax(axis=1) == main).all()
        assert axes.get_aspect() == 1.0
        scales.append(axes.get_position().width * width / np.ptp(axes.get_xlim()))
        assert (flat > [axes.get_xlim()[0], axes.get_ylim()[0]]).all()
        assert (flat < [axes.get_xlim()[1], axes.get_ylim()[1]]).all()
        rows = {jem.faces[p] for p in points}
        assert all(face in axes.get_title(loc="left") for face in rows)
    np.testing.assert_allclose(scales, scales[0])
