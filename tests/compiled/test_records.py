"""Records: their layout, and that compiled code and Python see the same values in them."""

from typing import Annotated

import numpy as np
import pytest
from compiled import called
from numba import config

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.interpreted import as_readable, interpreted
from mlivr_gym.compiled.kernels import entry, kernel
from mlivr_gym.compiled.records import Joints, Matrix, Record, Rows, Vector


class Ball(Record):
    """A ball."""

    centre: Vector
    radius: float


class Pack(Record):
    """Small fields before wide ones, arrays of numbers, a record and a tuple of records."""

    full: bool
    small: Annotated[int, np.int8]
    wide: int
    code: Annotated[int, np.uint16]
    counts: Annotated[IntArray, (3,), np.int8]
    turn: Matrix
    joints: Joints
    ball: Ball
    balls: Annotated[Rows[Ball], (2, 2)]
    flag: bool


class Flags(Record):
    """Nothing that is wider than a byte."""

    first: bool
    second: Annotated[int, np.int8]


class Outer(Record):
    """A record whose records begin with a small field."""

    flag: bool
    both: Flags
    packs: Annotated[Rows[Pack], (2,)]
    other: Annotated[int, np.int8]


def places(kind, start=0):
    """Place and type of every number of a type, nested ones and those of arrays too."""
    if kind.subdtype is not None:
        inner, shape = kind.subdtype
        for k in range(int(np.prod(shape))):
            yield from places(inner, start + k * inner.itemsize)
    elif kind.fields is None:
        yield start, kind
    else:
        for name in kind.names:
            inner, offset = kind.fields[name][:2]
            yield from places(inner, start + offset)


@pytest.mark.parametrize("record", [Ball, Pack, Flags, Outer])
def test_every_number_lies_where_its_type_wants_it(record):
    """Also in the second of two rows, and no two share a byte."""
    assert record.dtype.itemsize % max(kind.alignment for _, kind in places(record.dtype)) == 0
    free = np.ones(record.dtype.itemsize, dtype=bool)
    for start, kind in places(record.dtype):
        assert start % kind.alignment == 0
        assert free[start : start + kind.itemsize].all()
        free[start : start + kind.itemsize] = False


@kernel
def fill(pack: Pack, first: float) -> float:
    """Write a number into every field; returns the number after the last."""
    value = first
    pack.full, pack.flag = True, True
    pack.small, pack.wide, pack.code = -7, 1 << 40, 0xFFFF
    for k in range(3):
        pack.counts[k] = -k
        pack.ball.centre[k] = value
        value += 1.0
        for c in range(3):
            pack.turn[k, c] = value
            value += 1.0
    for k in range(6):
        pack.joints[k] = value
        value += 1.0
    pack.ball.radius = value
    value += 1.0
    for i in range(2):
        for j in range(2):
            ball = pack.balls[i, j]
            ball.radius = value
            value += 1.0
            for k in range(3):
                ball.centre[k] = value
                value += 1.0
    return value


@entry
def fill_all(outers: Array) -> float:
    """Fill the packs of rows of `Outer`; returns the number after the last."""
    value = 1.0
    for k in range(len(outers)):
        outers[k].other = k
        outers[k].both.second = -k
        for i in range(2):
            value = fill(outers[k].packs[i], value)
    return value


def plainly(pack, value):
    """What `fill` does, by items."""
    pack["full"], pack["flag"], pack["small"] = True, True, -7
    pack["wide"], pack["code"], pack["counts"] = 1 << 40, 0xFFFF, [0, -1, -2]
    numbers = value + np.arange(3 + 9 + 6 + 1 + 16)
    both, pack["joints"] = numbers[:12].reshape(3, 4), numbers[12:18]
    pack["ball"]["centre"], pack["turn"] = both[:, 0], both[:, 1:]
    pack["ball"]["radius"] = numbers[18]
    balls = numbers[19:].reshape(2, 2, 4)
    pack["balls"]["radius"], pack["balls"]["centre"] = balls[..., 0], balls[..., 1:]
    return value + len(numbers)


def test_a_record_in_an_array_of_records_is_written_in_place():
    ours, plain, value = Outer.rows(5), Outer.rows(5), 1.0
    for k in range(5):
        plain[k]["other"], plain[k]["both"]["second"] = k, -k
        for i in range(2):
            value = plainly(plain[k]["packs"][i], value)
    assert fill_all(ours) == value
    assert ours.tobytes() == plain.tobytes()
    assert ours["packs"]["ball"]["radius"].shape == (5, 2)
    np.testing.assert_array_equal(
        ours["packs"]["balls"]["centre"], plain["packs"]["balls"]["centre"]
    )


class Clash(Record):
    """Fields that are called like attributes of NumPy's scalars."""

    base: Ball
    size: int
    flags: Annotated[Rows[Flags], (2,)]


@kernel
def count_up(clash: Clash) -> float:
    """Change every field; returns what is read back."""
    clash.size = clash.size + 41
    clash.base.radius = 0.5
    clash.flags[1].second = 3
    return clash.size + clash.base.radius + 1000.0 * clash.flags[1].second


def test_a_field_may_be_called_like_an_attribute_of_numpy():
    clash = Clash.row()
    clash["size"] = 1
    assert called(count_up)(clash) == 3042.5
    assert (clash["size"], clash["base"]["radius"]) == (42, 0.5)
    assert clash["flags"]["second"].tolist() == [0, 3]


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="all is interpreted")
def test_interpreted_code_reads_and_writes_records_as_compiled_code_does():
    """Nested ones, arrays of records and fields that are called like attributes of NumPy's."""
    compiled, plain = Outer.rows(2), Outer.rows(2)
    function = interpreted(fill_all.py_func)
    assert function(as_readable(plain)) == fill_all(compiled)
    assert (compiled == plain).all()
    assert compiled["packs"]["ball"]["radius"].all()
