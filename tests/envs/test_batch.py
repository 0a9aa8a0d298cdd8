"""Random numbers of the vector environment against whole numbers of Python."""

import numpy as np
import pytest

from mlivr_gym.envs.batch import random_below

PUBLISHED = (
    6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431,
    16408922859458223821,
)  # fmt: skip
"""What splitmix64 gives from 1234567 on, as many implementations state for a test."""


def plain(state):
    """The next state and number of splitmix64."""
    limit = 2**64
    state = (state + 0x9E3779B97F4A7C15) % limit
    z = (state ^ state >> 30) * 0xBF58476D1CE4E5B9 % limit
    z = (z ^ z >> 27) * 0x94D049BB133111EB % limit
    return state, z ^ z >> 31


def test_the_plain_definition_gives_the_published_numbers():
    state, found = 1234567, []
    for _ in PUBLISHED:
        state, number = plain(state)
        found.append(number)
    assert tuple(found) == PUBLISHED


@pytest.mark.parametrize("bound", [1, 2, 331, 8732])
def test_numbers_below_a_bound(bound):
    """The upper 53 bits as a share of the bound; other streams stay as they are."""
    streams, state = np.array([5, 1234567, 2**64 - 1], dtype=np.uint64), 1234567
    with np.errstate(over="ignore"):
        for _ in range(200):
            state, number = plain(state)
            assert random_below(streams, 1, bound) == int((number >> 11) / 2**53 * bound)
    assert streams.tolist() == [5, state, 2**64 - 1]
