"""Arguments are checked by a schema, or else by their annotations."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Protocol, TypedDict, TypeVar

import numpy as np
import pytest
from typing_extensions import TypeAliasType

from mlivr_gym.arguments import checked, validator_of
from mlivr_gym.arrays import Array, BoolArray, IntArray
from mlivr_gym.errors import MapError, SettingError
from mlivr_gym.schema import FieldPath, Integer
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
