"""How kernels are compiled and run in threads."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from numba import njit


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function with Numba on its first call, cached on disk, free of the interpreter's lock."""
    options: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    return njit(**options)(function)


def in_parallel(count: int, kernel: Callable[..., None], *args: object, first: int = 0, least: int = 2000) -> None:
    """Call a compiled `kernel(start, stop, *args)` over `count` items from `first`, in threads from `least` items on."""
    workers = min(os.cpu_count() or 1, 8) if count >= least else 1
    if workers == 1:
        kernel(first, first + count, *args)
        return
    kernel(first, first, *args)
    edges = [first + count * w // workers for w in range(workers + 1)]
    with ThreadPoolExecutor(workers) as pool:
        for job in [pool.submit(kernel, edges[w], edges[w + 1], *args) for w in range(workers)]:
            job.result()
