"""Decorators that compile kernels with Numba, and the threads that share their work.

Decorators say who calls a function: only other kernels (`kernel`), exactly one kernel (`part`), or
Python (`entry`, `late_entry`). Only what Python calls is cached on disk, with all that it calls. A
late entry is one that takes long to compile and whose calls are few and short: Python interprets it
until that has taken some time, in all processes, so that a first plan does not wait for the
compiler.
"""

from __future__ import annotations

import atexit
import logging
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache, update_wrapper
from itertools import pairwise
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numba import config, njit
from numba.core import event

from mlivr_gym.compiled.cache import kernel_folder, make_private, writable_by_others
from mlivr_gym.compiled.compiling import compilation
from mlivr_gym.compiled.interpreted import as_readable, interpreted
from mlivr_gym.compiled.machine_code import (
    guard,
    is_stored,
    store_time_interpreted,
    time_interpreted,
)

Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")

OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "_nrt": False,
}
"""Options with which all kernels are compiled: no interpreter lock, no reference counts.

`_nrt` is the one private option of the compiler that is used. No kernel creates an array, so
nothing has to be counted; with counts, which are atomic, all postures of the JEM take 1.16 times as
long.
"""

MOST_THREADS = 8
"""Maximum number of threads that share the items of a call."""

PIECES_PER_THREAD = 4
"""Pieces into which items are divided for each thread, since some take longer than others."""

_compile: Any = njit  # its type stubs know only some of its options

event.register("numba:compile", compilation)

_warned: set[str] = set()
"""Folders about which a warning was given that they are not used."""


def kernel(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Compile a function that only other kernels call."""
    compiled: Callable[Parameters, Returned] = _compile(no_cpython_wrapper=True, **OPTIONS)(
        function
    )
    return compiled


def part(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Compile a function that is a part of one kernel, into which it is inlined.

    It is a function of its own only so that it can be read on its own.
    """
    compiled: Callable[Parameters, Returned] = _compile(
        no_cpython_wrapper=True, inline="always", **OPTIONS
    )(function)
    return compiled


def entry(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Compile a function that Python calls, on its first call, or load its cached machine code.

    The key of the machine code is the content of the file and of all files that it imports. Numba's
    own key is the file alone, with which a caller would keep old machine code of a callee that was
    edited in another file.
    """
    settings: Any = config  # its attributes are set when it is loaded
    given = settings.CACHE_DIR
    folder = given or str(kernel_folder(function.__code__.co_filename))
    settings.CACHE_DIR = folder
    try:
        cached = not settings.DISABLE_JIT and _usable(Path(folder))
        compiled: Callable[Parameters, Returned] = _compile(cache=cached, **OPTIONS)(function)
    finally:
        settings.CACHE_DIR = given
    if not settings.DISABLE_JIT:
        guard(compiled)
    return compiled


def late_entry(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Interpret a function that Python calls, and compile it once that has taken some time.

    Both give the same numbers. What it writes must not depend on what it finds there, since a call
    that the interpreter refuses is repeated.
    """
    settings: Any = config
    compiled = entry(function)
    late: Any = compiled if settings.DISABLE_JIT else LateEntry(compiled)
    called: Callable[Parameters, Returned] = late
    return called


class LateEntry:
    """Function that is interpreted until it is worth to compile it; see `late_entry`."""

    patience = 5.0
    """Processor time of interpretation in all processes after which a function is compiled [s]."""

    def __init__(self, compiled: Any) -> None:
        """Take the function as `entry` returns it."""
        self.py_func = compiled.py_func
        self._compiled = compiled
        self._spent = -1.0
        self._is_due = False
        update_wrapper(self, compiled.py_func)

    def __call__(self, *given: Any) -> Any:
        """Call the function."""
        if self._spent < 0.0:
            self._spent = time_interpreted(self._compiled)
            atexit.register(self._store_time)
        self._is_due = self._is_due or self._spent >= self.patience or is_stored(self._compiled)
        if not self._is_due:
            began = time.thread_time()
            try:
                with np.errstate(all="ignore"):
                    return interpreted(self.py_func)(*map(as_readable, given))
            except (ArithmeticError, ValueError):
                pass  # where machine code goes on with an infinity or no number
            finally:
                self._spent += time.thread_time() - began
        return self._compiled(*given)

    def _store_time(self) -> None:
        """Let later processes know the time that was spent."""
        if self._spent > 0.0 and not self._is_due:
            store_time_interpreted(self._compiled, self._spent)


def _usable(folder: Path) -> bool:
    """Create a cache folder and return whether this user, and no other, can write it.

    Otherwise warn once.
    """
    try:
        make_private(folder)
        opened = writable_by_others(folder)
        fault = opened and f"other users may change {opened}"
        fault = fault or ("" if os.access(folder, os.W_OK) else "it cannot be written")
    except OSError as error:
        fault = str(error)
    folder_name = str(folder.parent)
    if fault and folder_name not in _warned:
        _warned.add(folder_name)
        logging.getLogger(__name__).warning(
            "machine code is not cached in %s: %s; kernels are compiled in every process, which "
            "may take minutes; set MLIVR_GYM_CACHE to a folder that only you can write",
            folder_name,
            fault,
        )
    return not fault


def workers(count: int, least: int) -> int:
    """Return the number of threads for some items: one thread for fewer than `least` items."""
    return min(_cores(), MOST_THREADS) if count >= least else 1


def _cores() -> int:
    """Return the number of processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_parallel(
    count: int, kernel: Callable[..., None], *args: object, scratch_rows: Any, least: int = 2000
) -> None:
    """Call an entry `kernel(start, stop, *args, scratch)` over a range of items, `stop` excluded.

    From `least` items on it is called in several threads, each with a row of scratch of its own, of
    which `scratch_rows` creates a given number. Each thread takes the next piece of the items when
    it has finished one.
    """
    used = workers(count, least)
    scratch = scratch_rows(used)
    if used == 1:
        kernel(0, count, *args, scratch)
        return
    kernel(0, 0, *args, scratch[:1])
    number = min(count, PIECES_PER_THREAD * used)
    edges = [count * piece // number for piece in range(number + 1)]
    pieces = iter(list(pairwise(edges)))  # an iterator over a list, from which threads may take

    def work(thread: int) -> None:
        for start, stop in pieces:
            kernel(start, stop, *args, scratch[thread : thread + 1])

    jobs = [threads().submit(work, thread) for thread in range(1, used)]
    work(0)
    for job in jobs:
        if not job.cancel():  # it has started
            job.result()


@cache
def threads() -> ThreadPoolExecutor:
    """Return the threads, which are reused: starting one takes as long as a hundred step checks.

    What runs in one must not wait for another.
    """
    return ThreadPoolExecutor(MOST_THREADS)


if hasattr(os, "register_at_fork"):
    # A forked process does not inherit threads.
    os.register_at_fork(after_in_child=threads.cache_clear)
