"""Arguments and data are checked by a schema or by annotations; errors name place and value."""

import pickle
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol, TypedDict, TypeVar

import numpy as np
import pytest
from typing_extensions import TypeAliasType

from mlivr_gym.arguments import checked, validator_of
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import (
    MapError,
    MlivrError,
    SettingError,
    ShapeError,
    UnknownPointError,
    shortened,
)
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
from mlivr_gym.settings import Settings, base_threshold
from mlivr_gym.transitions.state import State

STATE = State((0, 1), (1, 1))

T = TypeVar("T", bound=np.generic)
Alias = TypeAliasType("Alias", np.ndarray[tuple[Any, ...], np.dtype[T]], type_params=(T,))
"""What `numpy.typing.NDArray` is from NumPy 2.5 on, and what it stands for before."""


class Walker(Protocol):
    def walk(self, steps: int) -> None: ...


class Dog:
    def walk(self, steps: int) -> None: ...


class Named(TypedDict):
    name: str


@pytest.mark.parametrize(
    ("annotation", "taken", "refused"),
    [
        (int, [3, -(2**63), np.int8(2)], [2**63, 1.0, True, "1", None]),
        (float, [3, 0.5, -0.0, np.float32(2.0)], [np.nan, np.inf, 1j, "1", [1.0], None, 10**400]),
        (bool, [True, np.False_], [0, "yes", None]),
        (str, ["", "deck"], ["\ud800", "a\0b", b"deck", 3]),
        (str | Path, ["a", Path("a")], ["a\0b", "\ud800", 3, b"a"]),
        (Any, [None, 3, object()], []),
        (State, [STATE], [((0, 1), (1, 1), None), State, None]),
        (State | None, [STATE, None], [3]),
        (State | Dog, [STATE, Dog()], [3, None]),
        (Walker, [Dog()], [Dog, STATE, None]),
        (Named, [{"name": "a"}], [["name"], None]),
        (Callable[[int], None], [print, lambda _: None], [int, 3, None]),
        (Sequence[int], [[1, 2], (), np.array([3])], [3, "12", [1.5], iter([1]), None]),
        (tuple[int, str], [(1, "a"), [1, "a"]], [(1,), ("a", 1), (1, "a", 2), None]),
        (Array, [[[1, 2.5]], np.zeros((2, 0)), ()], [[np.nan], [[1], [2, 3]], ["a"], 3, [1j]]),
        (IntArray, [np.array([1]), [1, 2], []], [[1.5], [True], ["a"], 3, None, [10**400]]),
        (BoolArray, [np.array([True]), [False]], [[1], [0.5], True, None]),
        (Alias[np.float64], [[[1, 2.5]], ()], [[np.nan], ["a"], 3]),
        (Alias[np.float64] | None, [[1.0], None], [["a"], 3]),
        (Sequence[float] | Alias[np.float64], [[1.0], np.ones(2)], [["a"], None]),
        (Sequence[float] | Array, [[1.0], np.ones(2)], [["a"], None]),
        (Annotated[int, Integer(2, 4)], [2, 4], [1, 5]),
    ],
)  # fmt: skip
def test_what_an_annotation_stands_for_is_taken(annotation, taken, refused):
    kind, place = validator_of(annotation), FieldPath("it", SettingError)
    for value in taken:
        kind.read(value, place)
    for value in refused:
        with pytest.raises(SettingError, match=r"^it"):
            kind.read(value, place)


def test_a_function_gets_what_was_read_and_late_checks_come_after_a_failure():
    calls = []

    @checked({"steps": Integer(1, 3)}, MapError)
    def early(steps: "int", points: "Array") -> "None":
        calls.append((steps, points))

    @checked(late=True)
    def late(state: "State") -> "int":
        calls.append(state)
        return state.stance[0]

    early(2, [[1, 2]])
    assert calls[-1][1].dtype == np.float64
    for wrong in ((4, [1.0]), (2, ["a"])):
        with pytest.raises(MapError):
            early(*wrong)
    assert len(calls) == 1
    assert late(STATE) == 0
    with pytest.raises(SettingError, match="state is 3; it must be a State"):
        late(3)
    with pytest.raises(IndexError):  # a fault of the function itself
        late(State((), ()))


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
NO_ROTATIONS = np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3), np.full((3, 3), 1e300)
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
        (PLACES, [[[1, 2, 3], [0, -4250, 0]]], r"walk\[1\]\[1\] is -4250, larger than 100 m; .*m"),
        (Tuples((), 0.0), [-1], "walk is -1.0; it must be at least 0"),
        (Tuples((), 1.0, 2.0, "kg"), [3], "walk is 3.0; it must be from 1 to 2 kg"),
        (ROWS, [[[1, 2]] * 4], "walk has 4 entries; it must have 0 to 3"),
        (ROWS, [[[1, 2, 3]]], r"has shape \(1, 3\)"),
        (ROWS, [None, 3, "ab", {}, np.array(3)], "it must be a list"),
        (Rotation(), NO_ROTATIONS, "walk must be a right-handed rotation matrix"),
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
    read = {"id": "R", "ends": ((0.0, 0.0, 0.0),)}
    assert FIELDS.read({"id": "R", "ends": [[0, 0, 0]]}, HERE) == read
    told = refusal(FIELDS, {"id": "R", "ends": [[0, 0, 0], [0, "x", 0]]})
    assert told.startswith("walk.ends[1] is [0, 'x', 0]")
    assert refusal(FIELDS, {"id": "R"}) == "walk.ends is missing"
    assert refusal(FIELDS, 3) == "walk is 3; it must be an object with id, ends, note, width"
    assert refusal(FIELDS, [], FieldPath("", SettingError)).startswith("the data is []; it must")
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
    assert "unknown field 'name'" in refusal(RAIL, {"id": "R", "name": "x"})
    with pytest.raises(ShapeError, match=r"^rail\.width is None"):
        Rail("R", None)
    assert isinstance(Rail("R", 1).width, float)
    whole = Struct.of(Rail, complete=True)  # which has no defaults
    assert refusal(whole, {"id": "R"}) == "walk.width is missing"
    assert whole.read({"id": "R", "width": 0.2}, HERE) == Rail("R", 0.2)


def test_base_threshold_falls_with_the_cube_of_the_number_of_limbs():
    assert [base_threshold(n) for n in (2, 4)] == [0.001, 0.000125]
    assert Settings().thresholds(3) == (0.1, pytest.approx(0.001 * 8 / 27))
    assert Settings(manipulability=False).thresholds(2) == (0.0, 0.0)


def test_any_value_is_shown_in_brief():
    deep = []
    for _ in range(100_000):
        deep = [deep]
    long = "x" * 10**6, list(range(10**6)), 10**5000, {k: k for k in range(1000)}
    for value in (deep, *long, "\ud800", np.zeros((9, 9))):
        assert len(shortened(value)) < 300
        assert shortened(value).isprintable()


def test_no_error_passes_control_characters_on():
    """Whoever quotes a foreign text in an error need not think of it: a terminal obeys them."""
    foreign = "\x1b]0;title\x07\x1b[2J\rfine\nsecond line\u202e"
    kinds, seen = [MlivrError], set()
    while kinds:
        kind = kinds.pop()
        seen.add(kind)
        kinds.extend(kind.__subclasses__())
        if "__init__" not in vars(kind) or kind is MlivrError:
            error = kind(f"cannot read it: {foreign}")
            assert str(error).isprintable()
            assert "title" in str(error)
            assert str(pickle.loads(pickle.dumps(error))) == str(error)
    assert {MapError, UnknownPointError} <= seen
    assert str(UnknownPointError("x", [foreign])).isprintable()
    for code in [*range(32), *range(127, 160), 0x202E, 0x2028, 0xFEFF]:  # each alone
        assert str(MlivrError(f"file {chr(code)} of another")).isprintable()
