"""Faulty input: data with parts replaced, files with bytes changed, and how many of each."""

import copy
import itertools
import math
import os
import resource
import signal
from contextlib import contextmanager
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from mlivr_gym import MlivrError, State
from mlivr_gym.errors import NoPlanError

VARIABLE = "MLIVR_GYM_FUZZ"
"""Environment variable that asks for a number of examples, others in each run."""

EXAMPLES = int(os.environ.get(VARIABLE, "600"))
"""Examples in all; the tests share them."""

MOST_SECONDS, MOST_BYTES = 20.0, 4 << 30
"""Processor time that one example may take [s], and what it may ask for besides what is in use."""

values = st.one_of(
    st.sampled_from([None, True, [], {}, "", "x", "\ud800", "a\0b", "limb0/flange", "body", "-"]),
    st.sampled_from([0, -1, 8, 1_000_000, 2**63, 10**250, 1e-300, 1e5, 1e19, 1e300, np.nan]),
    st.sampled_from(["x" * 10_000, [[[[]]]], {"a": {"b": []}}, [[0, 1], [2]], ["1", 2, None], 0.2]),
    st.floats(), st.integers(), st.text(max_size=5), st.lists(st.floats(), max_size=4),
).map(copy.deepcopy)  # fmt: skip


def few(share):
    """Settings of a test that takes a share of the examples."""
    return settings(
        max_examples=max(round(share * EXAMPLES), 1),
        deadline=None,
        derandomize=VARIABLE not in os.environ,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )


FACTORS = (-1, 0, 1e-9, 1e3, 1e9)

changes = st.lists(
    st.tuples(
        st.lists(st.integers(0, 9999), min_size=1, max_size=6),
        st.sampled_from(["scale", "leave out", "double", "add", "deeper", "replace"]),
        values,
        st.text(max_size=3),
        st.sampled_from(FACTORS),
    ),
    min_size=1,
    max_size=3,
)
"""Where, how and by what; what is drawn does not depend on the data."""


def mutated(data):
    """The data with one to three parts replaced, scaled, left out, doubled, put deeper or added."""
    return changes.map(lambda drawn: _changed(data, drawn))


def _changed(data, drawn):
    data = copy.deepcopy(data)
    for path, how, other, key, factor in drawn:
        place, last = None, None
        for number in path:
            inner = data if place is None else place[last]
            if not isinstance(inner, (dict, list)) or not inner:
                break
            keys = list(inner) if isinstance(inner, dict) else range(len(inner))
            place, last = inner, keys[number % len(keys)]
        if place is None:
            continue
        value = place[last]
        if how == "scale" and type(value) in (int, float):
            place[last] = value * factor
        elif how == "leave out":
            del place[last]
        elif how == "double" and isinstance(place, list):
            place.append(copy.deepcopy(value))
        elif how == "add" and isinstance(place, dict):
            place[key] = other
        elif how == "deeper":
            place[last] = {key: value} if factor > 0 else [value]
        else:
            place[last] = other
    return data


def damaged(content):
    """The bytes with some changed, put in, or cut off."""
    most = len(content)
    places = st.tuples(
        st.integers(0, most), st.integers(0, 9), st.binary(max_size=9), st.integers(0, 2 * most)
    )
    return places.map(lambda p: (content[: p[0]] + p[2] + content[p[0] + p[1] :])[: p[3]])


class TooMuchWorkError(AssertionError):
    """An example has taken more processor time than it may."""


@contextmanager
def bounded(seconds=MOST_SECONDS):
    """An example must end in time and without asking for all memory there is."""

    def end(number, frame):
        raise TooMuchWorkError(f"more than {seconds:g} s of processor time")

    with open("/proc/self/statm", encoding="ascii") as stream:
        used = int(stream.read().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, before[1]))
    handler = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, handler)
        resource.setrlimit(resource.RLIMIT_AS, before)


def loaded(load, path, content):
    """What a loader makes of a file, or None where it refuses it in one line that names it."""
    path.write_bytes(content)
    try:
        with bounded():
            return load(path)
    except MlivrError as error:
        told = str(error)
        assert path.stem in told
        assert told.isprintable()
        assert len(told) < 1500
    return None


class Shapeless:
    """An object that cannot be shown, and is in several lines where it is."""

    def __init__(self, told):
        self.told = told

    def __repr__(self):
        if self.told is None:
            raise RuntimeError("nothing to show")
        return self.told


def deep(count):
    """A list in a list, and so on."""
    found = []
    for _ in range(count):
        found = [found]
    return found


def given_values():
    """Values of every type, made anew: wrong ones for most arguments, right ones for some."""
    return [
        None, True, False, 0, 1, 2, -1, 1000, -1000, 2**63, 10**400, -(10**5000), 3.0, 0.5, -0.5,
        1e300, math.nan, math.inf, -math.inf, 1j, Decimal("0.5"), Fraction(1, 2),
        "", "deck", "steps", "no/such.json", "x" * 10_000, "\ud800", "a\nb", "a\0b", "\x1b[31m",
        b"x", bytearray(b"x"), Path("no/such"), Path("a\0b"),
        [], (), {}, set(), {1, 2}, {"kind": None}, {"a": {"b": []}}, {1: 2}, {"": 0}, range(3),
        [[]], [[0, 1], [2]], [None], [None, None], ["deck", 3], [math.nan] * 3, [10**400] * 3,
        -0.0, np.complex128(1j), Path("."), os.sep, str(Path.cwd()),
        itertools.count(), deep(10_000),
        [0.5, "1", 1j], [[[[1.0]]]], [True, False], ("", ""), (-1, -1), iter([]), (k for k in ()),
        object(), Shapeless("in\nlines"), Shapeless(None), lambda *_, **__: None, int, dict,
        np.ndarray, Ellipsis, NotImplemented, ValueError("no"), State((0, 1), (1, 1)),
        State(None, None), State(("deck", 3), (math.nan, [])),
        np.zeros((2, 3)), np.zeros((5, 0)), np.zeros(()), np.full(3, math.nan), np.array("deck"),
        np.array([None, "x"], object), np.array([[1], [2, 3]], object), np.array([1j, 2]),
        np.array(["a", "b"]), np.zeros(3, dtype=[("x", "f8")]), np.datetime64("NaT", "s"),
        np.float64(0.5), np.float32(math.nan), np.int64(2), np.uint8(3), np.bool_(True),
        np.str_("deck"),
    ]  # fmt: skip


def answer(call, name, shown=()):
    """The message with which a call refuses a value; None where it takes it, also in vain.

    Args:
        call: What calls.
        name: The argument's name, one of which the message has to have.
        shown: Other names of it.
    """
    try:
        call()
    except NoPlanError:
        return None
    except MlivrError as error:
        told = str(error)
        assert any(word in told for word in (name, *shown)), told
        assert told.isprintable(), told
        assert len(told) < 1500, told
        return told
    return None
