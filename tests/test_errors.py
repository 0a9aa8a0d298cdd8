import pickle

import numpy as np

from mlivr_gym.errors import MapError, MlivrError, UnknownPointError, shortened


def test_any_value_is_shown_in_brief():
    deep: list = []
    for _ in range(100_000):
        deep = [deep]
    for value in (
        deep,
        "x" * 10**6,
        list(range(10**6)),
        10**5000,
        "\ud800",
        {k: k for k in range(1000)},
        np.zeros((9, 9)),
    ):
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
