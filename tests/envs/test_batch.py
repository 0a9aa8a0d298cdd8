"""Random numbers of the vector environment against whole numbers of Python."""

import numpy as np
import pytest
from env_model import SplitMix

from mlivr_gym.envs.batch import random_below

PUBLISHED = (
    6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431,
    16408922859458223821,
)  # fmt: skip
"""What splitmix64 gives from 1234567 on, as many implementations state for a test."""


def plain(state):
    """The stream of the model of the environments from a state on."""
    stream = SplitMix(0)
    stream.state = state
    return stream


def test_the_model_gives_the_published_numbers():
    stream = plain(1234567)
    assert [stream.bits() for _ in PUBLISHED] == [number >> 11 for number in PUBLISHED]


@pytest.mark.parametrize("bound", [1, 2, 331, 8732])
def test_numbers_below_a_bound(bound):
    """The upper 53 bits as a share of the bound; other streams stay as they are."""
    streams, stream = np.array([5, 1234567, 2**64 - 1], dtype=np.uint64), plain(1234567)
    with np.errstate(over="ignore"):
        for _ in range(200):
            assert random_below(streams, 1, bound) == stream.below(bound)
    assert streams.tolist() == [5, stream.state, 2**64 - 1]
