"""A schema returns what the program works with, or names place, value and what it must be."""

import re
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pytest

from mlivr_gym.errors import SettingError, ShapeError
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


CHOICE = Choice(("base", "steps", "weighted"))
LENGTHS = Numbers((2, 2), 0.0, 100.0, "m")
PLACES = Numbers((None, 3), most=100.0, unit="m")
ROWS = Tuples((None, 2), rows=(0, 3))
SOME = ListOf(OrNone(Integer(0, 9)), 1, 3)
TURN = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
NO_NUMBERS = (
    None, True, "1", [1], {}, np.nan, np.inf, 10**400, [[1, 2], [3]], ["1", "2", "3"],
    [1, 2, None], [True, False, True], [1, True, 0.5], (0.0, np.False_, 1), [1, 2, "x"], object(),
)  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "value", "read"),
    [
        *((NAME, name, name) for name in ("D2a:4", "tool bag", "étagère", "きぼう")),
        (Text(least=0), "", ""),
        (Integer(0, 3), np.int64(3), 3),
        (Flag(), np.bool_(True), True),
        (CHOICE, "steps", "steps"),
        (Tuples((2, 1)), np.array([[1], [2]]), ((1.0,), (2.0,))),
        (Tuples(), 3, 3.0),
        (ROWS, [], ()),
        (ROWS, [[1, 2], [3, 4]], ((1.0, 2.0), (3.0, 4.0))),
        (Rotation(), np.array(TURN), TURN),
        (SOME, [1, None], (1, None)),
    ],
)
def test_a_valid_value_is_read(kind, value, read):
    assert kind.read(value, HERE) == read


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (NAME, ["", "a\nb", "a\0", "\ud800", "x" * 201, 3, None, ["a"]], "walk is "),
        (Integer(0, 3), [True, 2.0, -1, 4, "1", 10**5000, None], "a whole number from 0 to 3"),
        (Flag(), [0, 1, "true", None], "; it must be true or false"),
        (CHOICE, [None, [], {"a": 1}, "love"], "; valid choices are 'base', 'steps', 'weighted'"),
        (CHOICE, ["step"], "walk is 'step'; valid .*'weighted'; did you mean 'steps'"),
        (Numbers(()), NO_NUMBERS, "walk"),
        (Numbers((3,)), NO_NUMBERS, "walk"),
        (LENGTHS, [[[0, 1], [2, True]]], r"walk is \[\[0, 1\], \[2, True\]\]; it must be finite"),
        (LENGTHS, [[[0, 1], [-2, 3]]], r"walk\[1\]\[0\] is -2.0; it must be from 0 to 100 m"),
        (LENGTHS, [[[0, 4250], [2, 3]]], r"walk\[0\]\[1\] is 4250, larger than 100 m; .*metres"),
        (LENGTHS, [[[2, 3], [5, np.nan]]], r"\[1\]\[1\] is nan; it must be a finite number"),
        (
            PLACES,
            [[[1, 2, 3], [0, -4250, 0]]],
            r"walk\[1\]\[1\] is -4250, larger than 100 m; .*metr",
        ),
        (Tuples((), 0.0), [-1], "walk is -1.0; it must be at least 0"),
        (Tuples((), 1.0, 2.0, "kg"), [3], "walk is 3.0; it must be from 1 to 2 kg"),
        (ROWS, [[[1, 2]] * 4], "walk has 4 entries; it must have 0 to 3"),
        (ROWS, [[[1, 2, 3]]], r"has shape \(1, 3\)"),
        (ROWS, [None, 3, "ab", {}, np.array(3)], "it must be a list"),
        (
            Rotation(),
            [np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3), np.full((3, 3), 1e300)],
            "walk must be a right-handed rotation matrix",
        ),
        (SOME, [[1, 2, "x"]], r"walk\[2\] is 'x'; it must be a whole number"),
        (SOME, [[]], "walk has 0 entries; it must have 1 to 3"),
    ],
)
def test_an_invalid_value_is_refused_by_name(kind, values, words):
    for value in values:
        assert re.search(words, refusal(kind, value))


def test_rotations_of_a_stack_are_told_apart():
    stack = np.stack([np.eye(3), 2.0 * np.eye(3), np.array(TURN)])
    assert are_rotations(stack).tolist() == [True, False, True]


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
    id: Annotated[str, NAME]
    width: Annotated[float, Tuples()] = 0.1
    name: str = ""

    def __post_init__(self):
        RAIL.check(self, FieldPath("rail", ShapeError))
        if self.width > 1.0:
            raise ShapeError("too wide")


RAIL = Struct.of(Rail)


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
    whole = Struct.of(Rail, complete=True)
    assert refusal(whole, {"id": "R"}) == "walk.width is missing"
    assert whole.read({"id": "R", "width": 0.2}, HERE) == Rail("R", 0.2)
