import numpy as np

from mlivr_gym.errors import shortened


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
