"""Entries of map files are checked, and points at handrails left out."""

import pytest
from map_data import POINT, SEGMENT

from mlivr_gym import GraspMap, jem_map
from mlivr_gym.errors import MapError


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"normal": [0, 0, 2]}, r"^points\[0\].normal is .*of length 2"),
        ({"position": [0, float("nan"), 0]}, r"^points\[0\].position\[1\] is nan"),
        ({"rail": [0, 0, 1]}, r"^points\[0\] has a rail that is not at right angles"),
        ({"rail": [0, 0, 0]}, r"^points\[0\] has a rail without a direction"),
    ],
)
def test_a_fault_of_a_point_names_the_entry(change, words):
    with pytest.raises(MapError, match=words):
        GraspMap.from_dict({"points": [POINT | change]})


@pytest.mark.parametrize("spacing", [1e-9, 1e-7, 1e-6])
def test_too_small_a_spacing_is_refused_before_the_points_are_made(spacing):
    for make in (
        lambda: GraspMap.from_dict({"segments": [SEGMENT], "spacing": spacing}),
        lambda: jem_map(spacing=spacing),
    ):
        with pytest.raises(MapError, match="at most 100000; take a larger spacing"):
            make()
