"""A schema returns what the program works with, or names place, value and what it must be."""

from dataclasses import dataclass

import numpy as np
import pytest

from mlivr_gym.errors import MlivrError, SettingError, ShapeError, shortened
from mlivr_gym.schema import (
    NAME,
    Anything,
    Choice,
    FieldPath,
    Fields,
    Flag,
    Integer,
    ListOf,
    Numbers,
    OrNone,
    Rotation,
    Struct,
    Text,
    Tuples,
    are_rotations,
)

HERE = FieldPath("walk", SettingError)


def refusal(kind, value, place=HERE):
    """What is said of a value that is not of a kind."""
    with pytest.raises(SettingError) as told:
        kind.read(value, place)
    assert str(told.value).isprintable()
    assert len(str(told.value)) < 400
    return str(told.value)


@pytest.mark.parametrize("value", ["", "a\nb", "a\0", "\ud800", "x" * 201, 3, None, ["a"]])
def test_what_cannot_be_a_name_is_refused(value):
    assert refusal(NAME, value).startswith("walk is ")


def test_names_may_be_of_any_language():
    for name in ("D2a:4", "tool bag", "étagère", "きぼう"):
        assert NAME.read(name, HERE) == name
    assert Text(least=0).read("", HERE) == ""


def test_whole_numbers():
    assert Integer(0, 3).read(np.int64(3), HERE) == 3
    for value in (True, 2.0, -1, 4, "1", 10**5000, None):
        told = refusal(Integer(0, 3), value)
        assert told.startswith("walk is ")
        assert told.endswith("; it must be a whole number from 0 to 3")


def test_switches():
    assert Flag().read(np.bool_(True), HERE) is True
    for value in (0, 1, "true", None):
        assert refusal(Flag(), value).endswith("it must be true or false")


def test_a_choice_names_the_valid_ones_and_the_nearest():
    kind = Choice(("base", "steps", "weighted"))
    assert kind.read("steps", HERE) == "steps"
    told = "walk is 'step'; valid choices are 'base', 'steps', 'weighted'; did you mean 'steps'?"
    assert refusal(kind, "step") == told
    for value in (None, [], {"a": 1}, "love"):
        assert refusal(kind, value).endswith("'weighted'")


def test_numbers_have_a_shape_a_range_and_a_unit():
    np.testing.assert_array_equal(Numbers((2,)).read([1, 2], HERE), [1.0, 2.0])
    assert Tuples((2, 1)).read(np.array([[1], [2]]), HERE) == ((1.0,), (2.0,))
    assert Tuples().read(3, HERE) == 3.0
    length = Numbers((2, 2), 0.0, 100.0, "m")
    assert refusal(length, [[0, 1], [-2, 3]]) == "walk[1][0] is -2.0; it must be from 0 to 100 m"
    assert "walk[0][1] is 4250, larger than 100 m; lengths are in metres" in refusal(
        length, [[0, 4250.0], [2, 3]]
    )
    assert "walk[1][1] is nan; it must be a finite number" in refusal(length, [[2, 3], [5, np.nan]])
    assert refusal(Tuples((), 0.0), -1) == "walk is -1.0; it must be at least 0"
    assert refusal(Tuples((), 1.0, 2.0, "kg"), 3) == "walk is 3.0; it must be from 1 to 2 kg"


@pytest.mark.parametrize(
    "value",
    [None, True, "1", [1], {}, np.nan, np.inf, 10**400, [[1, 2], [3]], ["1", "2", "3"],
     [1, 2, None], [True, False, True], [1, 2, "x"], object()],
    ids=lambda value: shortened(value)[:20],
)  # fmt: skip
def test_what_is_no_number_is_refused_by_name(value):
    for shape in ((), (3,)):
        assert refusal(Numbers(shape), value).startswith("walk")


def test_the_number_of_rows_may_be_open():
    rows = Tuples((None, 2), rows=(0, 3))
    assert rows.read([], HERE) == ()
    assert rows.read([[1, 2], [3, 4]], HERE) == ((1.0, 2.0), (3.0, 4.0))
    assert refusal(rows, [[1, 2]] * 4) == "walk has 4 entries; it must have 0 to 3"
    assert "has shape (1, 3)" in refusal(rows, [[1, 2, 3]])
    for value in (None, 3, "ab", {}, np.array(3)):
        assert refusal(rows, value).endswith("it must be a list")


def test_rotations():
    turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    assert Rotation().read(turn, HERE) == ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    for value in (np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3), np.full((3, 3), 1e300)):
        assert refusal(Rotation(), value) == "walk must be a right-handed rotation matrix"
    stack = np.stack([np.eye(3), 2.0 * np.eye(3), np.array(turn)])
    assert are_rotations(stack).tolist() == [True, False, True]


def test_lists_and_what_may_be_missing():
    kind = ListOf(OrNone(Integer(0, 9)), 1, 3)
    assert kind.read([1, None], HERE) == (1, None)
    assert refusal(kind, [1, 2, "x"]).startswith("walk[2] is 'x'; it must be a whole number")
    assert refusal(kind, []) == "walk has 0 entries; it must have 1 to 3"


FIELDS = Fields({"id": NAME, "ends": ListOf(Tuples((3,)))}, {"note": Anything(), "width": Tuples()})


def test_fields_are_read_and_the_faulty_one_is_named_by_its_path():
    assert FIELDS.read({"id": "R", "ends": [[0, 0, 0]]}, HERE) == {
        "id": "R",
        "ends": ((0.0, 0.0, 0.0),),
    }
    told = refusal(FIELDS, {"id": "R", "ends": [[0, 0, 0], [0, "x", 0]]})
    assert told.startswith("walk.ends[1] is [0, 'x', 0]")
    assert refusal(FIELDS, {"id": "R"}) == "walk.ends is missing"
    assert refusal(FIELDS, {"id": "R"}, FieldPath("", SettingError)) == "ends is missing"
    assert refusal(FIELDS, 3) == "walk is 3; it must be an object with id, ends, note, width"
    assert refusal(FIELDS, [], FieldPath("", SettingError)).startswith(
        "the data is []; it must be an"
    )


def test_an_unknown_field_is_refused_with_the_nearest_known_name():
    told = refusal(FIELDS, {"id": "R", "ends": [], "widht": 1})
    assert told == (
        "walk has an unknown field 'widht'; valid fields are id, ends, note, width; "
        "did you mean 'width'?"
    )
    for name in ("\ud800", "x" * 10**6, 3, None):
        assert "unknown field" in refusal(FIELDS, {name: 1})
    assert Fields({"id": NAME}, others=True).read({"id": "R", "x": 1}, HERE) == {"id": "R", "x": 1}


@dataclass(frozen=True)
class Rail:
    id: str
    width: float = 0.1
    name: str = ""

    def __post_init__(self):
        RAIL.check(self, FieldPath("rail", ShapeError))
        if self.width > 1.0:
            raise ShapeError("too wide")


RAIL = Struct(Rail, {"id": NAME, "width": Tuples()})


def test_a_record_is_made_of_its_fields_and_checks_itself():
    assert RAIL.read({"id": "R", "width": 1}, HERE) == Rail("R", 1.0)
    assert RAIL.read({"id": "R"}, HERE) == Rail("R")
    made = Rail("R")
    assert RAIL.read(made, HERE) is made
    assert refusal(RAIL, {"id": "R", "width": "x"}).startswith("walk.width is 'x'")
    assert refusal(RAIL, {"id": "R", "width": 2}) == "walk: too wide"
    assert refusal(RAIL, {"id": "R", "width": 2}, FieldPath("", SettingError)) == "too wide"
    assert refusal(RAIL, {"width": 1}) == "walk.id is missing"
    assert "unknown field 'name'" in refusal(RAIL, {"id": "R", "name": "x"})
    with pytest.raises(ShapeError, match=r"^rail\.width is None"):
        Rail("R", None)
    assert isinstance(Rail("R", 1).width, float)


def test_a_complete_record_has_no_defaults():
    whole = Struct(Rail, RAIL.validators, complete=True)
    assert refusal(whole, {"id": "R"}) == "walk.width is missing"
    assert whole.read({"id": "R", "width": 0.2}, HERE) == Rail("R", 0.2)


def test_errors_are_of_the_type_that_is_asked_for():
    with pytest.raises(ShapeError):
        NAME.read(3, FieldPath("walk", ShapeError))
    assert issubclass(ShapeError, MlivrError)
