import json
from dataclasses import replace

import numpy as np
import pytest
from map_data import BOX, POINT, RAIL, SEGMENT

from mlivr_gym import GraspMap, MlivrError, Settings, jem_map, stance_graph
from mlivr_gym.robot.specification import EVEN
from mlivr_gym.world.map_entries import MARGIN

LARGE = "is .*larger than 1000 m; for a map in millimetres give unit 'mm'"


def test_the_measured_map_has_331_of_414_points(jem):
    assert len(jem) == 331
    assert len(jem.segments) == 46
    assert len(jem.handrails) == 18
    on_tracks = {f"{segment.id}:{k}" for segment in jem.segments for k in range(9)}
    assert len(on_tracks) == 414
    assert set(jem.ids) < on_tracks


@pytest.mark.parametrize(("clearance", "left_out"), [(0.0, 39), (0.03, 83), (0.06, 89), (0.10, 99)])
def test_points_left_out_at_handrails_match_the_measured_counts(clearance, left_out):
    assert 414 - len(jem_map(clearance=clearance)) == left_out


def test_points_lie_on_their_tracks_with_outward_normals(jem):
    centre = jem.positions.mean(axis=0)
    for point, position, rotation in zip(jem.ids, jem.positions, jem.rotations, strict=True):
        segment = next(s for s in jem.segments if s.id == point.split(":")[0])
        start, end = np.array(segment.start), np.array(segment.end)
        along = (end - start) / np.linalg.norm(end - start)
        assert np.linalg.norm(np.cross(position - start, along)) < 1e-9
        assert 0 < (position - start) @ along < np.linalg.norm(end - start)
        np.testing.assert_allclose(rotation[:, 0], along, atol=1e-9)
        assert (centre - position) @ rotation[:, 2] > 0.5


def test_sparse_map_halves_the_points_and_clears_the_deck(jem):
    sparse = jem.sparse(3, keep=("D1a:4",), clear_deck=(1.5, 6.0))
    assert sparse.ids == jem.sparse(3, keep=("D1a:4",), clear_deck=(1.5, 6.0)).ids
    assert len(jem.sparse(3)) == len(sparse) == len(jem) // 2
    deck = [sparse.positions[i, 0] for i, face in enumerate(sparse.faces) if face == "deck"]
    assert all(not 1.5 < x < 6.0 for x in deck)
    assert "D1a:4" in sparse.ids


def test_points_and_segments_load_from_a_file(tmp_path):
    path = tmp_path / "map.json"
    path.write_text(json.dumps({"points": [POINT], "segments": [SEGMENT], "spacing": 0.25}))
    loaded = GraspMap.load(path)
    assert loaded.ids == ("P", "S:0", "S:1", "S:2", "S:3", "S:4")
    heights = (0.0, 0.25, 0.5, 0.75, 1.0)
    np.testing.assert_allclose(loaded.positions[1:], [[0, 1, z] for z in heights], atol=1e-12)
    assert loaded.name == "map"
    assert loaded.fingerprint != jem_map().fingerprint


def test_maps_are_equal_if_their_data_are(jem):
    again = GraspMap.from_dict(jem.to_dict())
    assert again == jem
    assert len({again, jem}) == 1
    assert jem != jem.subset(np.arange(len(jem)) > 0, jem.name)
    assert jem != 0


def test_rounding_does_not_make_another_map(jem):
    """The last digits of turned boxes differ between machines; a plan serves on all of them."""
    nudged = [
        replace(box, centre=tuple(value + 1e-13 for value in box.centre)) for box in jem.boxes
    ]
    moved = [
        replace(jem.boxes[0], half=tuple(1.01 * value for value in jem.boxes[0].half)),
        *jem.boxes[1:],
    ]
    same, other = (replace(jem, boxes=tuple(boxes)) for boxes in (nudged, moved))
    assert same.fingerprint == jem.fingerprint != other.fingerprint


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"points": [POINT, POINT]}, "'P' appears more than once"),
        (
            {"points": [POINT], "boxes": [BOX], "handrails": [RAIL | {"id": "B"}]},
            "box 'B' appears more than once",
        ),
        ({"points": [POINT | {"normal": [0, 0, 2]}]}, r"^points\[0\].normal is .*of length 2"),
        ({"points": [POINT | {"rail": [0, 0, 1]}]}, r"^points\[0\] .* is not at right angles"),
        ({"points": [POINT | {"position": [0, 0, 5230.0]}]}, rf"points\[0\].position\[2\] {LARGE}"),
    ],
)
def test_a_fault_of_a_map_is_named(data, words):
    with pytest.raises(MlivrError, match=words):
        GraspMap.from_dict(data)


def test_without_a_cabin_the_base_may_be_anywhere_near_the_points():
    """What the robots that ship reach from two points on a slope is no goal outside the cabin."""
    points = [POINT | {"id": f"P{k}", "position": [0.5 * k, 0, 0.1 * k]} for k in range(3)]
    loaded = GraspMap.from_dict({"points": points})
    np.testing.assert_array_equal(loaded.cabin, [[-1.5, -1.5, -1.5], [2.5, 1.5, 1.7]])
    farthest = max(robot.reach for robot in EVEN.values())
    assert MARGIN - 0.15 < farthest < MARGIN
    graph = stance_graph(loaded, settings=Settings(manipulability=False, collisions=False))
    heights = graph.posture((0, 1)).base_position
    loaded.check_goal(heights[0])


def test_a_face_may_have_any_name_and_handrails_keep_points_of_theirs_away():
    rail = {"id": "H", "face": "lab wall", "min": [-0.1, -0.1, 0], "max": [0.1, 0.1, 0.1]}
    other = POINT | {"id": "Q", "face": "lab wall"}
    loaded = GraspMap.from_dict({"points": [POINT, other], "handrails": [rail]})
    assert loaded.ids == ("P",)
    assert GraspMap.from_dict({"points": [POINT, other]}).faces == ("deck", "lab wall")
