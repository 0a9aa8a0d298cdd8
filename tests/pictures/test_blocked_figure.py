"""The picture of what is blocked names shapes in words and marks where they meet, in scale."""

import numpy as np
import pytest

from mlivr_gym import Box
from mlivr_gym.collisions.contacts import contacts
from mlivr_gym.pictures import blocked_figure as module
from mlivr_gym.pictures.blocked_figure import Panel, blocked_figure
from mlivr_gym.pictures.robot_shapes import robot_parts
from mlivr_gym.robot.specification import robot_spec


@pytest.fixture
def drawn(jem, monkeypatch, tmp_path):
    robot, kept = robot_spec("mlivr2"), []
    here = (np.array([3.0, 0.1, 0.0]), np.array([1.0, 0, 0, 0]), np.full((2, 6), 0.4))
    (forearm,) = (p for p in robot_parts(robot, here) if p.name == "limb0/forearm/0")
    along = np.diff(forearm.axes[0], axis=0)[0]
    along /= np.linalg.norm(along)
    aside = np.cross(along, [0.0, 0.6, 0.8])
    aside /= np.linalg.norm(aside)
    turn = np.stack([along, np.cross(aside, along), aside], axis=1)
    middle = forearm.axes[0].mean(axis=0) + (forearm.radius + 0.012 + 0.03) * aside
    box = Box("cargo", "obstacle", tuple(middle), (0.05, 0.04, 0.03), Box.rows(turn))
    found = contacts(robot, [box], here, 0.02)
    assert found
    assert found[0].first == "limb0/forearm/0"
    panel = Panel("A posture\nbeside a box", here, found)
    monkeypatch.setattr(module, "write_figure", lambda figure, path: kept.append(figure))
    blocked_figure(jem, robot, [panel], [box], tmp_path / "blocked.png", clearance=0.02)
    return kept[0], found[0]


def test_the_contact_is_marked_in_both_views(drawn):
    figure, contact = drawn
    overview, close_up = figure.axes
    rings = [c for c in overview.collections if not c.get_facecolor().size and c.get_offsets().size]
    assert len(rings) == 1
    (mark,) = (x for x in close_up.lines if x.get_color() == module.MARK_COLOUR)
    gap = np.linalg.norm(np.diff(mark.get_xydata(), axis=0))
    assert gap == pytest.approx(contact.distance, abs=1e-4)  # the view keeps it
    assert close_up.get_aspect() == 1.0
    (bar,) = (x for x in close_up.lines if x.get_color() == "black")
    assert np.ptp(bar.get_xdata()) == pytest.approx(0.1)
    low, high = close_up.get_ylim()
    assert low < mark.get_ydata().min() < mark.get_ydata().max() < high
