"""Maps from tables and in other units: read as such, and one clear line for each fault."""

import json
from copy import deepcopy

import numpy as np
import pytest
from map_data import BOX, LADDER, POINT, RAIL, SEGMENT

from mlivr_gym import GraspMap
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MapError, SettingError

JEM = json.loads(asset_path("jem.json").read_text(encoding="utf-8"))
LENGTHS = {
    "position", "start", "end", "width", "thickness", "spacing", "min", "max", "bar_min", "bar_max",
    "clearance", "centre", "half", "translation", "resolution",
}  # fmt: skip
"""Fields that are lengths; others are names, directions, rotations and remarks."""

PER_METRE = {"mm": 1000, "cm": 100, "in": 1 / 0.0254, "ft": 1 / 0.3048}
"""Units in a metre: an inch is 25.4 mm by definition, and a foot is twelve of them."""


def in_unit(data, unit, name="map", many=list):
    """A map with all lengths in another unit; those of its parts say their own."""
    if isinstance(data, dict):
        scaled = {key: in_unit(inner, unit, key, many) for key, inner in data.items()}
        return scaled | {"unit": unit} if name == "map" else scaled
    if isinstance(data, list):
        return many(in_unit(inner, unit, name, many) for inner in data)
    is_length = name in LENGTHS and isinstance(data, int | float)
    return PER_METRE[unit] * data if is_length else deepcopy(data)


TURNED = {"id": "T", "centre": [5, 0, 0], "half": [1, 1, 2]}
PART = {"id": "L", "map": LADDER, "translation": [0, 4, 0]}
WHOLE = {
    "points": [POINT | {"position": [0.2, -0.4, 1]}], "segments": [SEGMENT | {"width": 0.1}],
    "spacing": 0.25, "boxes": [BOX, TURNED], "handrails": [RAIL], "clearance": 0.02, "parts": [PART]
}  # fmt: skip


@pytest.mark.parametrize(
    ("data", "unit", "many"),
    [(JEM, "in", tuple), *((WHOLE, unit, list) for unit in PER_METRE)],
    ids=["jem", *PER_METRE],
)
def test_a_map_in_another_unit_is_that_in_metres(data, unit, many):
    expected = GraspMap.from_dict(data).to_dict()
    found = GraspMap.from_dict(in_unit(data, unit, many=many)).to_dict()
    for name in ("positions", "rotations", "cabin"):
        np.testing.assert_allclose(found.pop(name), expected.pop(name), atol=1e-12)
    for name in ("boxes", "segments", "handrails"):
        for one, other in zip(found.pop(name), expected.pop(name), strict=True):
            assert one.keys() == other.keys()
            for key, value in other.items():
                if isinstance(value, str):
                    assert one[key] == value
                else:
                    np.testing.assert_allclose(one[key], value, atol=1e-12)
    assert found == expected


def wall(*positions, **fields):
    """A map of points."""
    points = [POINT | {"id": f"P{k}", "position": list(p)} for k, p in enumerate(positions)]
    return {"points": points} | fields


FAR_POINTS = wall([0, 876, 0], [200, 876, 0], [0, 900, 0], [200, 900, 0])
RAILS = {"segments": [SEGMENT | {"start": [0, 876, 0], "end": [600, 876, 0]}]}


@pytest.mark.parametrize("data", [RAILS, RAILS | {"spacing": 200}, FAR_POINTS, wall([0, -876, 0])])
def test_what_is_far_away_is_refused_until_it_says_its_unit(data):
    words = r"looks like another unit: give the unit, one of 'mm', 'cm', 'in', 'ft', or 'm' for m"
    with pytest.raises(MapError, match=words):
        GraspMap.from_dict(data)
    metres = GraspMap.from_dict(data | {"unit": "m"})
    assert GraspMap.from_dict(metres.to_dict()) == metres  # a saved map is in metres
    small = GraspMap.from_dict(data | {"unit": "mm"})
    assert np.abs(small.positions).max() < 1.0


@pytest.mark.parametrize(
    "data",
    [
        wall(*([13.0 * k, 0, 0] for k in range(7))),
        {"segments": [SEGMENT | {"start": [0, 1, 0], "end": [0, 1, 83]}]},
        {"parts": [{"id": "T", "map": "truss", "translation": [500, 0, 0]}]},
    ],
    ids=["grapple fixtures", "a rail along the truss", "a part"],
)
def test_what_is_in_metres_is_not_taken_for_another_unit(data):
    assert len(GraspMap.from_dict(data))


def test_a_table_may_be_in_millimetres(tmp_path):
    path = tmp_path / "rack.csv"
    header = "id,x,y,z,nx,ny,nz,rx,ry,rz"
    path.write_text(f"{header}\nA,0,1876,0,0,0,1,1,0,0\nB,0,1900,0,0,0,1,1,0,0\n")
    found = GraspMap.from_csv(path, unit="mm", cabin={"min": [0, 0, 0], "max": [2000, 2000, 2000]})
    np.testing.assert_allclose(found.positions, [[0, 1.876, 0], [0, 1.9, 0]])
    np.testing.assert_allclose(found.cabin, [[0, 0, 0], [2, 2, 2]])
    np.testing.assert_allclose(GraspMap.load(path, unit="mm").positions, found.positions)


def test_who_loads_a_map_may_say_its_unit_but_not_another_than_the_map(tmp_path):
    path, data = tmp_path / "map.json", in_unit(LADDER, "mm")
    for given in (data, {name: value for name, value in data.items() if name != "unit"}):
        path.write_text(json.dumps(given))
        assert GraspMap.load(path, unit="mm") == GraspMap.from_dict(LADDER)
    path.write_text(json.dumps(LADDER | {"unit": "m"}))
    with pytest.raises(MapError, match="unit is 'm' in the file, but 'mm' is given"):
        GraspMap.load(path, unit="mm")
    with pytest.raises(SettingError, match="unit is 'km'; valid choices are 'm', 'mm', 'cm', 'in'"):
        GraspMap.load(path, unit="km")


HEADER = "id,x,y,z,nx,ny,nz,rx,ry,rz,face"
ROWS = ("A,0,0,0,0,0,1,1,0,0,floor", "B,0.4,0,0,0,0,1,1,0,0,floor", "C,0.8,0.1,0,0,0,1,1,0,0,wall")


def written(tmp_path, *lines):
    path = tmp_path / "rack.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_table_makes_the_map_that_json_makes(tmp_path):
    points = [
        {"id": i, "face": f, "position": p, "normal": [0, 0, 1], "rail": [1, 0, 0]}
        for i, f, p in (
            ("A", "floor", [0, 0, 0]), ("B", "floor", [0.4, 0, 0]), ("C", "wall", [0.8, 0.1, 0]),
        )
    ]  # fmt: skip
    expected = GraspMap.from_dict({"points": points}, name="rack")
    unnamed = "D,1.2,0,0,0,0,1,1,0,0,"  # on the face of the file's name
    assert GraspMap.load(written(tmp_path, HEADER, *ROWS, unnamed)).faces[-1] == "rack"
    for header in (HEADER, f"\ufeff{HEADER}"):  # as Excel writes it
        path = written(tmp_path, header, ROWS[0], "", *ROWS[1:])
        if header != HEADER:
            path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
        for found in (GraspMap.load(path), GraspMap.from_csv(path)):
            assert found.to_dict() == expected.to_dict()
    boxes = [{"id": "locker", "min": [0, 1, 0], "max": [1, 2, 1]}]
    assert len(GraspMap.from_csv(path, boxes=boxes).boxes) == 1
    with pytest.raises(MapError, match="points is given beside"):
        GraspMap.from_csv(path, points=[])


def test_comments_are_no_points(tmp_path):
    """Before the header, between rows and at the end; a quote in one opens nothing."""
    comments = ['# measured, in "metres"', "#P1,0,2,0,0,0,1,1,0,0,floor", '  # ,"not closed', "#"]
    rows = [line for row in (HEADER, *ROWS) for line in (*comments, row)]
    found = GraspMap.load(written(tmp_path, *rows, *comments))
    assert found == GraspMap.load(written(tmp_path, HEADER, *ROWS))
    assert found.ids == ("A", "B", "C")


def test_a_hash_within_a_row_begins_no_comment(tmp_path):
    """Ids and faces may have one, as rails that are numbered do."""
    rows = ("rail#1,0,0,0,0,0,1,1,0,0,#2", "B#,0.4,0,0,0,0,1,1,0,0,a # b")
    found = GraspMap.load(written(tmp_path, HEADER, *rows))
    assert (found.ids, found.faces) == (("rail#1", "B#"), ("#2", "a # b"))


def test_columns_come_in_any_order_and_the_face_is_that_of_the_file(tmp_path):
    path = written(tmp_path, "rz, ry, rx, nz, ny, nx, z, y, x, id", "0,0,1,1,0,0,3,2,1,P")
    found = GraspMap.load(path)
    assert found.ids == ("P",)
    assert found.faces == ("rack",)
    np.testing.assert_allclose(found.positions, [[1.0, 2.0, 3.0]])
    np.testing.assert_allclose(found.rotations[0], np.eye(3))


@pytest.mark.parametrize(
    ("lines", "parts"),
    [
        (("id,x,y,z", "A,0,0,0"), ("line 1", "lacks the column 'nx'")),
        ((HEADER, ROWS[0], "B,1,2"), ("line 3 has 3 values", "11")),
        ((HEADER, "A,0,zero,0,0,0,1,1,0,0,f"), ("line 2: y is 'zero'", "finite number")),
        (
            (HEADER, ROWS[0], "", "B,0,0,0,0,0,2,1,0,0,f"),
            ("line 4: normal is [0.0, 0.0, 2.0], of length 2", "its length must be 1"),
        ),
        ((HEADER, *ROWS, ROWS[1]), ("line 5: id is 'B', which line 3 has already",)),
        (("# a table", "", HEADER, "#", "# A,0", "B,1,2"), ("line 6 has 3 values", "11")),
    ],
)
def test_a_fault_names_its_line_and_what_would_be_valid(tmp_path, lines, parts):
    with pytest.raises(MapError) as error:
        GraspMap.load(written(tmp_path, *lines))
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith("map '")
    assert "rack.csv': " in message
    for part in parts:
        assert part in message
