"""Figures of a module are checked one by one."""

import json

import numpy as np
import pytest

from mlivr_gym import GraspMap, MlivrError
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MapError
from mlivr_gym.world.rails import Handrail
from mlivr_gym.world.surroundings import handrail_boxes


def test_every_figure_of_the_scene_is_needed_and_named():
    """A hole or a fault anywhere in the figures of the JEM is one error that says where."""
    jem = json.loads(asset_path("jem.json").read_text(encoding="utf-8"))

    def places(found, path):
        for key, value in found.items():
            yield (*path, key)
            if isinstance(value, dict):
                yield from places(value, (*path, key))

    unused = {"rack_post_section", "jlp_hatch_ring", "end_bulkhead_x", "inner_hatch_diameter"}
    seen = 0
    for path in places(jem["scene"], ()):
        if unused & set(path) or path == ("panel_planes",):
            continue
        for fault in (None, "far", [], {"a": 1}, 1e7):
            data = json.loads(json.dumps(jem))
            place = data["scene"]
            for key in path[:-1]:
                place = place[key]
            if fault is None:
                del place[path[-1]]
            else:
                place[path[-1]] = fault
            with pytest.raises(MapError, match=r"scene\." + r"\.".join(path)):
                GraspMap.from_dict(data)
            seen += 1
    assert seen > 80


@pytest.mark.parametrize(
    "change", [{"face": "port"}, {"id": "\ud800"}, {"x_centre": "far"}, {"run_centre": None}, 3]
)
def test_a_faulty_rack_is_named(change):
    jem = json.loads(asset_path("jem.json").read_text(encoding="utf-8"))
    jem["racks"][4] = change if change == 3 else jem["racks"][4] | change
    with pytest.raises(MlivrError, match=r"racks\[4\]|id of a box"):
        GraspMap.from_dict(jem)


def test_closeouts_join_the_ends_of_their_section_in_all_four_corners(jem):
    data = json.loads(asset_path("jem.json").read_text(encoding="utf-8"))
    section, found = np.array(data["scene"]["corner_closeout"]), set()
    for box in jem.boxes:
        if box.kind == "closeout":
            vertical, sideways = box.id.split("/")[:2]
            corner = (-1 if sideways == "forward" else 1, -1 if vertical == "deck" else 1)
            ends = np.insert(section * corner, 0, box.centre[0], axis=1)
            local = (ends - box.centre) @ np.array(box.rotation)
            np.testing.assert_allclose(local[0], -local[1], atol=1e-12)
            assert (np.abs(local) <= np.array(box.half) + 1e-12).all()
            assert np.abs(local[:, 2]).max() < 1e-12
            found.add(corner)
    assert len(found) == 4


@pytest.mark.parametrize("axis", "xyz")
def test_a_handrail_is_a_bar_on_two_posts(axis):
    """The posts fill its bounding box at both ends and take in the ends of the bar."""
    along = "xyz".index(axis)
    low, high = np.array([1.0, 2.0, 3.0]), np.array([1.1, 2.1, 3.1])
    high[along] = low[along] + 0.7
    bar_low, bar_high = low + 0.02, high - 0.02
    bar_low[along], bar_high[along] = low[along] + 0.03, high[along] - 0.04
    rail = Handrail("H", "deck", tuple(low), tuple(high), axis, tuple(bar_low), tuple(bar_high))
    bar, first, second = handrail_boxes(rail)
    assert [(box.id, box.kind, box.face) for box in (bar, first, second)] == [
        ("H", "handrail", "deck"),
        ("H/post0", "stanchion", "deck"),
        ("H/post1", "stanchion", "deck"),
    ]
    np.testing.assert_allclose(bar.bounds, [bar_low, bar_high])
    ends = [high.copy(), low.copy()]
    ends[0][along], ends[1][along] = bar_low[along] + 0.008, bar_high[along] - 0.008
    np.testing.assert_allclose(first.bounds, [low, ends[0]])
    np.testing.assert_allclose(second.bounds, [ends[1], high])


@pytest.mark.parametrize("known", [{"bar_min": (1.0, 2.0, 3.0)}, {"bar_max": (1.1, 2.6, 3.1)}])
def test_a_bar_of_which_one_corner_is_known_is_refused(known):
    with pytest.raises(MapError, match="it must have both or neither"):
        Handrail("H", "deck", (1.0, 2.0, 3.0), (1.1, 2.7, 3.1), "y", **known)


def test_a_handrail_whose_bar_is_not_known_is_its_bounding_box():
    rail = Handrail("H", "deck", (1.0, 2.0, 3.0), (1.1, 2.7, 3.1), "y")
    (box,) = handrail_boxes(rail)
    assert (box.id, box.kind) == ("H", "handrail")
    np.testing.assert_allclose(box.bounds, [(1.0, 2.0, 3.0), (1.1, 2.7, 3.1)])
