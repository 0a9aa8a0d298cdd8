"""Maps joined of others: rigid transforms change nothing but places, and faults are named."""

import json

import numpy as np
import pytest
from map_data import LADDER
from scipy.spatial.transform import Rotation

from mlivr_gym import GraspMap, Settings, stance_graph
from mlivr_gym.errors import MapError

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
