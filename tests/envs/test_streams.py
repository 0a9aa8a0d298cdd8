"""The random numbers of an environment: splitmix64, alike in Python and in the kernel."""

import numpy as np
import pytest
from env_model import SplitMix
from scipy.stats import chisquare

from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.vector_env import MlivrVectorEnv


@pytest.mark.parametrize("bound", [2, 7, 790, 10**6])
def test_numbers_are_those_of_the_model(bound):
    stream, other = Stream.of_seed(3), SplitMix(3)
    ours = [stream.integers(bound) for _ in range(2000)]
    assert ours == [other.below(bound) for _ in range(2000)]


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
