"""Walls, racks and rails of the module stand where they were measured."""

import json

import numpy as np
import pytest

from mlivr_gym.envs_assets import asset_path
from mlivr_gym.world.grasp_map import GraspMap
from mlivr_gym.world.rails import Handrail, Segment


def test_closeouts_join_the_ends_of_their_section_in_all_four_corners(jem):
    data = json.loads(asset_path("jem.json").read_text(encoding="utf-8"))
    section, found = np.array(data["provenance"]["figures"]["corner_closeout"]), set()
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


def test_racks_carry_the_tracks_that_are_named_after_them(jem):
    """The measured middles and spans: each track lies over the rack or the gap beside it."""
    data = json.loads(asset_path("jem.json").read_text(encoding="utf-8"))
    racks = {box.id: box for box in jem.boxes if box.kind == "rack"}
    for name, box in racks.items():
        assert 2.0 * box.half[0] == data["provenance"]["figures"]["rack_outer_span"]
        for track in (track for track in jem.segments if track.id[:-1] == name):
            assert abs(track.start[0] - box.centre[0]) < box.half[0]
    assert {track.id[:-1] for track in jem.segments} == set(racks)


@pytest.mark.parametrize("seed", range(2))
def test_a_track_is_a_strip_under_the_line_of_its_grasps(seed):
    """Its corners, by the ends of the line: half a width to each side, and a thickness down."""
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(-5.0, 5.0, (2, 3))
    normal = np.linalg.svd((end - start)[None])[2][1 + seed % 2]
    width, thickness = rng.uniform(0.01, 0.1, 2)
    track = Segment("T", "deck", tuple(start), tuple(end), tuple(normal), width, thickness)
    box = track.box
    assert (box.id, box.kind, box.face) == ("T", "track", "deck")
    side = np.cross(normal, end - start) / np.linalg.norm(end - start)
    corners = [
        to + 0.5 * width * sign * side - depth * normal
        for to in (start, end) for sign in (-1, 1) for depth in (0.0, thickness)
    ]  # fmt: skip
    local = (np.array(corners) - box.centre) @ np.array(box.rotation)
    np.testing.assert_allclose(np.abs(local), np.tile(box.half, (8, 1)), atol=1e-12)
    assert len(np.unique(np.sign(local), axis=0)) == 8
    np.testing.assert_allclose(np.array(box.rotation)[:, 2], normal, atol=1e-12)


@pytest.mark.parametrize("axis", "xyz")
def test_a_handrail_is_a_bar_on_two_posts(axis):
    """The posts fill its bounding box at both ends and take in the ends of the bar."""
    along = "xyz".index(axis)
    low, high = np.array([1.0, 2.0, 3.0]), np.array([1.1, 2.1, 3.1])
    high[along] = low[along] + 0.7
    bar_low, bar_high = low + 0.02, high - 0.02
    bar_low[along], bar_high[along] = low[along] + 0.03, high[along] - 0.04
    rail = Handrail("H", "deck", tuple(low), tuple(high), axis, tuple(bar_low), tuple(bar_high))
    bar, first, second = rail.boxes
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


def test_points_under_a_handrail_are_left_out_however_far_it_stands_off_the_wall():
    """Seat tracks 20 mm wide along x on two faces, and one handrail along y before the deck.

    Points keep 30 mm from its sides in the plane of the wall: half their width counts across the
    track, and not along it; how far it stands off does not count.
    """
    tracks = [
        {"id": name, "face": face, "start": [-1, y, z], "end": [1, y, z], "normal": [0, 0, n],
         "width": 0.02}
        for name, face, y, z, n in (
            ("inside", "deck", 0.339, -1, 1), ("outside", "deck", 0.341, -1, 1),
            ("opposite", "overhead", 0.0, 1, -1),
        )
    ]  # fmt: skip
    rail = {"id": "H", "face": "deck", "min": [0.17, -0.3, -0.9], "max": [0.23, 0.3, -0.8]}
    rail |= {"axis": "y", "bar_min": [0.19, -0.28, -0.82], "bar_max": [0.21, 0.28, -0.8]}
    grasp_map = GraspMap.from_dict(
        {"segments": tracks, "handrails": [rail], "spacing": 0.05, "clearance": 0.03}
    )
    kept = dict(zip(grasp_map.ids, grasp_map.positions[:, 0].tolist(), strict=True))
    every = np.arange(-20, 21) * 0.05
    for track in ("outside", "opposite"):
        assert sorted(x for i, x in kept.items() if i.startswith(track)) == pytest.approx(every)
    free = every[(every < 0.14) | (every > 0.26)]
    assert sorted(x for i, x in kept.items() if i.startswith("inside")) == pytest.approx(free)
