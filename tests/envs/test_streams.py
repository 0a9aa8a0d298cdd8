"""Random numbers of the environments: splitmix64, in Python and in the kernel."""

import numpy as np
import pytest
from env_model import SplitMix
from scipy.stats import chisquare

from mlivr_gym.envs.batch import random_below
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.vector_env import MlivrVectorEnv

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


@pytest.mark.parametrize("bound", [1, 331, 10**6])
def test_numbers_below_a_bound(bound):
    """The upper 53 bits as a share of the bound; other streams stay as they are."""
    ours, other = Stream.of_seed(3), SplitMix(3)
    assert [ours.integers(bound) for _ in range(200)] == [other.below(bound) for _ in range(200)]
    streams, stream = np.array([5, 1234567, 2**64 - 1], dtype=np.uint64), plain(1234567)
    with np.errstate(over="ignore"):
        for _ in range(200):
            assert random_below(streams, 1, bound) == stream.below(bound)
    assert streams.tolist() == [5, stream.state, 2**64 - 1]


def test_a_choice_has_no_value_twice_and_every_order():
    stream = Stream.of_seed(1)
    drawn = [tuple(stream.choice([4, 5, 6], 2, replace=False)) for _ in range(3000)]
    assert all(a != b for a, b in drawn)
    pairs, counts = np.unique(drawn, axis=0, return_counts=True)
    assert len(pairs) == 6
    assert chisquare(counts).pvalue > 1e-3


def test_without_a_seed_every_copy_has_a_stream_of_its_own(small_map, cache):
    copies = MlivrVectorEnv(80, map=small_map, collisions=False)
    copies.reset()
    assert len(set(copies._streams.tolist())) == 80
    single, states = MlivrEnv(map=small_map, collisions=False), set()
    for _ in range(80):
        single._seeded, single._np_random = False, None
        single.reset()
        states.add(single._stream.state)
    assert len(states) == 80
