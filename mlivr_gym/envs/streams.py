"""Random streams of the environments; the vector environment has one for each sub-environment."""

from __future__ import annotations

from typing import Any

import numpy as np

MODULUS = 2**64
"""Number of states of a stream."""


class Stream:
    """Random numbers by splitmix64 (Steele, Lea and Flood, 2014), as in `batch.random_below`.

    The first state is the first 64-bit word of `numpy.random.SeedSequence(seed)`. A number in [0,
    1) is made from the upper 53 bits of one word; an integer below n is the integer part of n times
    such a number.
    """

    def __init__(self, state: int) -> None:
        """Start from a state."""
        self.state = state

    @classmethod
    def of_seed(cls, seed: int) -> Stream:
        """Return the stream of a seed."""
        return cls(int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0]))

    def random(self) -> float:
        """Return a number in [0, 1)."""
        self.state = (self.state + 0x9E3779B97F4A7C15) % MODULUS
        z = self.state
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 % MODULUS
        z = (z ^ z >> 27) * 0x94D049BB133111EB % MODULUS
        return float((z ^ z >> 31) >> 11) * 2.0**-53

    def integers(self, low: int, /) -> int:
        """Return an integer from 0 to `low` - 1."""
        return int(self.random() * low)

    def choice(self, a: Any, size: int, /, *, replace: bool = False) -> Any:
        """Return `size` different values of `a`, in random order."""
        order = np.arange(len(a))
        for k in range(size):
            other = k + self.integers(len(order) - k)
            order[[k, other]] = order[[other, k]]
        return np.asarray(a)[order[:size]]
