"""Points from a table: the same map as from JSON, and one clear line for each fault."""

import numpy as np
import pytest

from mlivr_gym import GraspMap
from mlivr_gym.errors import MapError

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
