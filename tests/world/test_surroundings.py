"""Figures of a module are checked one by one."""

import json

import pytest

from mlivr_gym import GraspMap, MlivrError
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MapError


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
