"""Maps: the measured JEM, its rails and racks, maps from files, and maps joined of others."""

import json
from dataclasses import replace

import numpy as np
import pytest
from map_data import BOX, LADDER, POINT, RAIL, SEGMENT
from scipy.spatial.transform import Rotation

from mlivr_gym import GraspMap, MlivrError, Settings, jem_map, stance_graph
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MapError
from mlivr_gym.robot.specification import EVEN
from mlivr_gym.world.map_entries import MARGIN
from mlivr_gym.world.rails import Handrail, Segment

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


TURN = Rotation.from_euler("xyz", [0.3, -0.8, 2.0])
PLACE = [3.0, -2.0, 1.0]
LOCKER = {"id": "locker", "min": [0.3, -0.2, 0.0], "max": [0.6, 0.2, 0.5]}
LADDER_WITH_BOX = {**LADDER, "boxes": [LOCKER]}


def part(name="A", given=LADDER_WITH_BOX, **where):
    return {"id": name, "map": given, **where}


def placed(**where):
    return GraspMap.from_dict({"parts": [part(**where)]})


def test_a_part_that_is_turned_and_moved_has_the_same_stances():
    """Distances, manipulability and what boxes remove do not depend on the frame."""
    alone = GraspMap.from_dict(LADDER_WITH_BOX)
    moved = placed(translation=PLACE, rotation=TURN.as_matrix().tolist())
    np.testing.assert_allclose(
        moved.positions, TURN.apply(alone.positions.copy()) + PLACE, atol=1e-12
    )
    np.testing.assert_allclose(moved.normals, TURN.apply(alone.normals.copy()), atol=1e-12)
    assert moved.ids == tuple(f"A/{point}" for point in alone.ids)
    free = stance_graph(GraspMap.from_dict(LADDER))
    first, second = stance_graph(alone), stance_graph(moved)
    assert len(first) < len(free)
    np.testing.assert_array_equal(first.points, second.points)
    np.testing.assert_allclose(first.w_m, second.w_m, atol=1e-9)
    bases = TURN.apply(first.base_position) + PLACE
    np.testing.assert_allclose(second.base_position, bases, atol=1e-6)


def test_parts_stand_side_by_side_and_are_climbed_over_their_border():
    shift = [1.8, 0.0, 0.0]
    own = {"id": "P", "face": "deck", "position": [3.0, 0.5, 0], "normal": [0, 0, 1],
           "rail": [1, 0, 0]}  # fmt: skip
    joined = GraspMap.from_dict(
        {"name": "two", "parts": [part(), part("B", translation=shift)], "points": [own]}
    )
    count = len(GraspMap.from_dict(LADDER))
    assert len(joined) == 1 + 2 * count
    assert joined.ids[0] == "P"
    assert [box.id for box in joined.boxes if "locker" in box.id] == ["A/locker", "B/locker"]
    np.testing.assert_allclose(joined.boxes[4].centre, np.add(joined.boxes[0].centre, shift))
    np.testing.assert_allclose(joined.cabin, [[-1, -1, 0], [4.8, 1, 2]])
    graph = stance_graph(joined, settings=Settings(collisions=False))
    names = np.array([point.split("/")[0] for point in joined.ids])[graph.points]
    assert (names[:, 0] != names[:, 1]).any()


def test_a_part_is_named_by_file_or_name(tmp_path, monkeypatch):
    (tmp_path / "ladder.json").write_text(json.dumps(LADDER))
    (tmp_path / "two.json").write_text(
        json.dumps({"parts": [part("A", "ladder.json"), part("B", "jem", translation=[0, 0, 9])]})
    )
    both = GraspMap.load(tmp_path / "two.json")
    assert len(both) == len(GraspMap.from_dict(LADDER)) + 331
    again = GraspMap.from_dict(both.to_dict())
    assert again.fingerprint == both.fingerprint


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ([part(), part()], "part 'A' appears more than once"),
        ([part(rotation=np.diag([1, 1, -1]).tolist())], r"parts\[0\]\.rotation must be a right-h"),
        ([part(given={"points": []})], r"parts\[0\]\.map.*no graspable point"),
    ],
)
def test_a_faulty_part_is_refused_with_its_entry(parts, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MapError, match=words) as caught:
        GraspMap.from_dict({"parts": parts})
    assert "\n" not in str(caught.value)


def test_a_map_that_is_a_part_of_itself_is_refused(tmp_path):
    file = tmp_path / "loop.json"
    file.write_text(json.dumps({"parts": [part("A", "loop.json")]}))
    with pytest.raises(MapError, match="part of itself") as caught:
        GraspMap.load(file)
    assert len(str(caught.value)) < 500
