"""Sets stored as the bits of one integer: sets of indices, and sets of branches of a limb.

A limb that holds a point is on one of eight branches of inverse kinematics, with the tool in one of
two positions half a turn apart, its flip. Bit `branch + 8 * flip` of a branch set stands for one of
these. Branches that share the shoulder and wrist choices form a class, `2 * shoulder + wrist`;
reach and `w_m` are the same for all of a class.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from mlivr_gym.compiled.kernels import kernel

EMPTY, NONE = cast(int, np.int64(0)), cast(int, np.int64(-1))
"""The empty set, and the index that stands for no item.

Both are 64-bit integers: Numba would compile a kernel once more for the type of a literal.
"""

NO, YES = cast(bool, np.bool_(False)), cast(bool, np.bool_(True))
"""Arguments of kernels that are always False or True, not literals for the same reason."""

EVERY = cast(int, np.int64(-1))
"""The set of all items."""

LAST = 62
"""Item from which on all items share a bit, so that what holds for one holds for all."""

BRANCHES = 8
"""Number of branches of a limb."""

ALL = cast(int, np.int64(0xFFFF))
"""Branch set of every branch with both flips."""

CLASSES = 4
"""Number of combinations of shoulder and wrist choices."""


def bits_of(branch_set: int) -> list[int]:
    """Return the members of a branch set, each as `branch + 8 * flip`."""
    return [bit for bit in range(2 * BRANCHES) if int(branch_set) >> bit & 1]


@kernel
def has(items: int, k: int) -> bool:
    """Return whether a set contains item `k`."""
    return items >> min(k, LAST) & 1 != 0


@kernel
def only(k: int) -> int:
    """Return the set of item `k` alone."""
    return 1 << min(k, LAST)


@kernel
def below(k: int) -> int:
    """Return the set of the items before `k` and of those that share a bit with them."""
    return -1 if k > LAST else (1 << k) - 1


@kernel
def both_flips(branch: int) -> int:
    """Return the branch set of a branch with both flips."""
    return 0x0101 << branch


@kernel
def any_flip(branch_set: int) -> int:
    """Return the branch set of the branches of a branch set, each with both flips."""
    return (branch_set | branch_set >> BRANCHES | branch_set << BRANCHES) & 0xFFFF


@kernel
def has_branch(branch_set: int, branch: int) -> bool:
    """Return whether a branch set has a branch with any flip."""
    return branch_set & (0x0101 << branch) != 0


@kernel
def without_branch(branch_set: int, branch: int) -> int:
    """Return a branch set without a branch."""
    return branch_set & ~(0x0101 << branch)


@kernel
def whole_class(choice: int) -> int:
    """Return the branch set of the branches of a class, each with both flips."""
    return 0x0303 << (2 * choice)


@kernel
def class_of(branch: int) -> int:
    """Return the class of a branch."""
    return branch >> 1
