"""Sets as bits: of items by number, and of the branches of a limb (compiled).

A limb at a grasp is on one of eight branches, with the tool in one of two positions half a turn
apart, the flip. A set of these has bit `branch + 8 * flip`. Branches that share the shoulder and
wrist choices are a class, `2 * shoulder + wrist`: for those reach and `w_m` are the same.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from mlivr_gym.compiled.kernels import kernel

EMPTY, NONE = cast(int, np.int64(0)), cast(int, np.int64(-1))
"""The empty set, and an index that is none.

As 64-bit numbers: what begins with a literal is compiled once more for its type.
"""

EVERY = cast(int, np.int64(-1))
"""The set of all items."""

LAST = 62
"""Items from this one on share a bit: what holds of one holds of all."""

BRANCHES = 8
"""Number of branches of a limb."""

ALL = cast(int, np.int64(0xFFFF))
"""Every branch and flip."""

CLASSES = 4
"""Number of shoulder and wrist choices."""


@kernel
def has(items: int, k: int) -> bool:
    """Whether a set has item `k`."""
    return items >> min(k, LAST) & 1 != 0


@kernel
def only(k: int) -> int:
    """The set of item `k`."""
    return 1 << min(k, LAST)


@kernel
def below(k: int) -> int:
    """The set of the items before `k`, and of what shares a bit with them."""
    return -1 if k > LAST else (1 << k) - 1


@kernel
def both_flips(branch: int) -> int:
    """The set of a branch with both flips."""
    return 0x0101 << branch


@kernel
def any_flip(mask: int) -> int:
    """The set of the branches of a set with both flips."""
    return (mask | mask >> BRANCHES | mask << BRANCHES) & 0xFFFF


@kernel
def has_branch(mask: int, branch: int) -> bool:
    """Whether a set has a branch, with any flip."""
    return mask & (0x0101 << branch) != 0


@kernel
def without_branch(mask: int, branch: int) -> int:
    """A set without a branch."""
    return mask & ~(0x0101 << branch)


@kernel
def without_flip(mask: int, branch: int, flip: int) -> int:
    """A set without a branch with one flip."""
    return mask & ~(1 << (branch + 8 * flip))


@kernel
def has_class(mask: int, choice: int) -> bool:
    """Whether a set has a branch of a class."""
    return mask >> (2 * choice) & 0x0303 != 0


@kernel
def without_class(mask: int, choice: int) -> int:
    """A set without the branches of a class."""
    return mask & ~(0x0303 << (2 * choice))


@kernel
def whole_class(choice: int) -> int:
    """The set of the branches of a class, with both flips."""
    return 0x0303 << (2 * choice)


@kernel
def class_of(branch: int) -> int:
    """The class of a branch."""
    return branch >> 1


@kernel
def first_branch(mask: int) -> int:
    """The least branch of a set that is not empty."""
    branch = EMPTY
    while branch < BRANCHES - 1 and not has_branch(mask, branch):
        branch += 1
    return branch
