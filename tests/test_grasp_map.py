import json
from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym import GraspMap, MlivrError, jem_map
from mlivr_gym.errors import GoalError, MapError, SettingError, UnknownPointError


def test_the_measured_map_has_331_of_414_points(jem):
    assert len(jem) == 331
    assert len(jem.segments) == 46 and len(jem.handrails) == 18
    on_tracks = {f"{segment.id}:{k}" for segment in jem.segments for k in range(9)}
    assert len(on_tracks) == 414 and set(jem.ids) < on_tracks


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


def test_spacing_is_a_parameter(jem):
    dense = jem_map(spacing=0.1)
    assert max(int(point.split(":")[1]) for point in dense.ids) == 16
    assert {tuple(p) for p in jem.positions.round(9)} <= {tuple(p) for p in dense.positions.round(9)}


def test_sparse_map_halves_the_points_and_clears_the_deck(jem):
    sparse = jem.sparse(3, keep=("D1a:4",), clear_deck=(1.5, 6.0))
    assert sparse.ids == jem.sparse(3, keep=("D1a:4",), clear_deck=(1.5, 6.0)).ids
    assert len(jem.sparse(3)) == len(jem) // 2
    deck = [sparse.positions[i, 0] for i, face in enumerate(sparse.faces) if face == "deck"]
    assert all(not 1.5 < x < 6.0 for x in deck) and "D1a:4" in sparse.ids


POINT = {"id": "P", "face": "deck", "position": [0, 0, 0], "normal": [0, 0, 1], "rail": [1, 0, 0]}


def test_points_and_segments_load_from_a_file(tmp_path):
    path = tmp_path / "map.json"
    segment = {"id": "S", "face": "aft", "start": [0, 1, 0], "end": [0, 1, 1], "normal": [0, -1, 0]}
    path.write_text(json.dumps({"points": [POINT], "segments": [segment], "spacing": 0.25}))
    loaded = GraspMap.load(path)
    assert loaded.ids == ("P", "S:0", "S:1", "S:2", "S:3", "S:4")
    assert loaded.name == "map"
    assert loaded.fingerprint != jem_map().fingerprint


def test_rounding_does_not_make_another_map(jem):
    """The last digits of turned boxes differ between machines; a plan made on one must serve on the other."""
    nudged = [replace(box, centre=tuple(value + 1e-13 for value in box.centre)) for box in jem.boxes]
    moved = [replace(jem.boxes[0], half=tuple(1.01 * value for value in jem.boxes[0].half)), *jem.boxes[1:]]
    same, other = (replace(jem, boxes=tuple(boxes)) for boxes in (nudged, moved))
    assert same.fingerprint == jem.fingerprint != other.fingerprint


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"normal": [0, 0, 2]}, "'P': normal"),
        ({"position": [0, float("nan"), 0]}, "'P': position"),
        ({"rail": [0, 0, 1]}, "'P': the rail"),
        ({"rail": [0, 0, 0]}, "'P': the rail"),
        ({"face": "cellar"}, "'cellar'"),
        ({"id": ""}, "number 0"),
        ({"position": [0, 0]}, "'P': position"),
        ({"position": "here"}, "'P': position"),
    ],
)
def test_a_fault_of_a_point_names_the_entry(change, words):
    with pytest.raises(MapError, match=words):
        GraspMap.from_dict({"points": [POINT | change]})


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({}, "no graspable point"),
        ([], "JSON object"),
        ({"points": {}}, "points must be a list"),
        ({"points": [POINT, POINT]}, "'P' appears more than once"),
        ({"points": [POINT], "cabin": {"min": [0, 0, 0], "max": [0, 1, 1]}}, "min below max"),
        ({"points": [POINT], "cabin": 3}, "cabin"),
        ({"segments": [{"id": "S", "face": "deck", "start": [0, 0, 0]}]}, "'end' is missing"),
        ({"points": [POINT], "spacing": "wide"}, "spacing is 'wide'"),
    ],
)
def test_a_fault_of_a_map_is_named(data, words):
    with pytest.raises(MapError, match=words):
        GraspMap.from_dict(data)


def test_missing_and_broken_files_are_named(tmp_path):
    with pytest.raises(MapError, match="nowhere"):
        GraspMap.load(tmp_path / "nowhere.json")
    broken = tmp_path / "broken.json"
    broken.write_text("{")
    with pytest.raises(MapError, match=r"broken\.json"):
        GraspMap.load(broken)
    faulty = tmp_path / "faulty.json"
    faulty.write_text(json.dumps({"points": [POINT | {"face": "cellar"}]}))
    with pytest.raises(MapError, match=r"faulty\.json.*'cellar'"):
        GraspMap.load(faulty)


@pytest.mark.parametrize("spacing", [0.0, -1.0, float("nan"), float("inf")])
def test_spacing_must_be_above_zero(spacing):
    with pytest.raises(SettingError, match="spacing"):
        jem_map(spacing=spacing)


def test_goals_are_checked(jem):
    np.testing.assert_array_equal(jem.check_goal((6.0, 0.0, 0.42)), [6.0, 0.0, 0.42])
    for goal in ((60, 0, 0), (1, 2), ("a", 0, 0), (float("nan"), 0, 0)):
        with pytest.raises(GoalError, match="goal"):
            jem.check_goal(goal)


def test_unknown_points_are_named(jem):
    with pytest.raises(UnknownPointError, match="'X9:9'.*331 points.*D1a:0"):
        jem.index("X9:9")
    with pytest.raises(UnknownPointError, match="331"):
        jem.index(331)
    assert issubclass(UnknownPointError, MlivrError)
