"""How kernels are compiled, cached and run in threads.

A `kernel` is called by other kernels alone, a `part` by one of them; an `entry` is where Python
enters compiled code. Only entries are kept on disk, with all that they call.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from numba import config, njit

from mlivr_gym.compiled.cache import kernel_folder, source_digest
from mlivr_gym.compiled.ready_made import offer

Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")

OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "_nrt": False,
}
"""What all kernels are compiled with: free of the interpreter's lock, without reference counts.

`_nrt` is the one private option of the compiler that is used. No kernel makes an array, so nothing
needs to be counted; with counts, which are atomic, all postures of the JEM take 1.16 times as long.
"""

MOST_THREADS = 8
"""Most threads that share the items of a call."""

_compile: Any = njit  # it is typed for some of its options

_told: set[str] = set()
"""Folders of which it was said that they cannot be written."""


def kernel(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Compile a function that only kernels call."""
    compiled: Callable[Parameters, Returned] = _compile(no_cpython_wrapper=True, **OPTIONS)(
        function
    )
    return compiled


def part(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """A part of one kernel, written apart to be read; it is compiled with that."""
    compiled: Callable[Parameters, Returned] = _compile(
        no_cpython_wrapper=True, inline="always", **OPTIONS
    )(function)
    return compiled


def entry(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Compile a function that Python calls, on its first call; cached on disk, or ready-made.

    The key is the content of its file and of all files that it imports. Numba's is the file alone:
    a caller would keep old machine code of a callee that was edited in another file.
    """
    settings: Any = config  # its attributes are set as it is loaded
    given = settings.CACHE_DIR
    folder = given or str(kernel_folder(function.__code__.co_filename))
    settings.CACHE_DIR = folder
    try:
        cached = not settings.DISABLE_JIT and _writable(folder)
        compiled: Callable[Parameters, Returned] = _compile(cache=cached, **OPTIONS)(function)
    finally:
        settings.CACHE_DIR = given
    if not settings.DISABLE_JIT:
        offer(compiled, source_digest(Path(function.__code__.co_filename)))
    return compiled


def _writable(folder: str) -> bool:
    """Whether files can be kept in a folder, which is made; says once if not."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        able = os.access(folder, os.W_OK)
    except OSError:
        able = False
    place = str(Path(folder).parent)
    if not able and place not in _told:
        _told.add(place)
        logging.getLogger(__name__).warning(
            "machine code cannot be kept in %s: what is not ready-made is compiled anew in every "
            "process, which may take a minute; set MLIVR_GYM_CACHE to a folder that can be written",
            place,
        )
    return able


def workers(count: int, least: int) -> int:
    """Number of threads for some items: one for fewer than `least`."""
    return min(_cores(), MOST_THREADS) if count >= least else 1


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_parallel(
    count: int, kernel: Callable[..., None], *args: object, scratch_rows: Any, least: int = 2000
) -> None:
    """Call an entry `kernel(start, stop, *args, room)` over `count` items.

    From `least` items on it is called in threads, each with a row of `scratch_rows` for scratch.

    Parameters
    ----------
    count
        Number of items.
    kernel
        The entry.
    args
        Its arguments between the range and the room.
    scratch_rows
        Makes rows of scratch records, given their number.
    least
        See above.
    """
    used = workers(count, least)
    scratch = scratch_rows(used)
    if used == 1:
        kernel(0, count, *args, scratch)
        return
    kernel(0, 0, *args, scratch[:1])
    edges = [count * w // used for w in range(used + 1)]
    jobs = [
        _threads().submit(kernel, edges[w], edges[w + 1], *args, scratch[w : w + 1])
        for w in range(1, used)
    ]
    kernel(0, edges[1], *args, scratch[:1])
    for job in jobs:
        job.result()


@cache
def _threads() -> ThreadPoolExecutor:
    """Threads that are kept: to start one takes as long as to check a hundred steps."""
    return ThreadPoolExecutor(MOST_THREADS)


if hasattr(os, "register_at_fork"):
    # A process that is forked has none of the threads.
    os.register_at_fork(after_in_child=_threads.cache_clear)
