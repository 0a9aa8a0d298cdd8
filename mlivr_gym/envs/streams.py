"""Random numbers of an environment: one stream for each copy, alike in both environments."""

from __future__ import annotations

from typing import Any

import numpy as np

MODULUS = 2**64


class Stream:
    """splitmix64 (Steele, Lea and Flood, 2014), as the vector environment draws it.

    A seed gives the first state: the first 64-bit word of `numpy.random.SeedSequence(seed)`. A
    number in [0, 1) is made of the upper 53 bits of one word, a whole number below n is the whole
    part of n times such a number.
    """

    def __init__(self, state: int) -> None:
        """Begin with a state."""
        self.state = state

    @classmethod
    def of_seed(cls, seed: int) -> Stream:
        """Begin with a seed."""
        return cls(int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0]))

    def random(self) -> float:
        """A number in [0, 1)."""
        self.state = (self.state + 0x9E3779B97F4A7C15) % MODULUS
        z = self.state
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 % MODULUS
        z = (z ^ z >> 27) * 0x94D049BB133111EB % MODULUS
        return float((z ^ z >> 31) >> 11) * 2.0**-53

    def integers(self, low: int, /) -> int:
        """A whole number from 0 to `low` - 1."""
        return int(self.random() * low)

    def choice(self, a: Any, size: int, /, *, replace: bool = False) -> Any:
        """`size` different ones of the values `a`, in random order."""
        order = np.arange(len(a))
        for k in range(size):
            other = k + self.integers(len(order) - k)
            order[[k, other]] = order[[other, k]]
        return np.asarray(a)[order[:size]]
