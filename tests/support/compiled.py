"""Kernels, which compiled code alone can call, called from tests."""

from functools import cache

from numba import config, njit


@cache
def called(kernel):
    """A kernel as a function that Python can call."""
    if config.DISABLE_JIT:
        return kernel
    return njit(error_model="numpy")(lambda *args: kernel(*args))
