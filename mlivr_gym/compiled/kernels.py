"""How kernels are compiled and run in threads.

Compiling takes seconds, once for an installation. Where the cache is empty, `second_process`
compiles the planner's kernels beside those of the stance graph.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from numba import config, njit

from mlivr_gym.compiled.cache import kernel_folder

Parameters = ParamSpec("Parameters")
Returned = TypeVar("Returned")

OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
}
"""What all kernels are compiled with."""

WAIT = 120.0
"""How long the second process may go on after the block [s]; then the kernels are compiled here."""


def kernel(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """Compile a function with Numba on its first call, cached on disk.

    It runs free of the interpreter's lock, and without reference counts: they are atomic, took a
    third of the time, and let threads wait for each other. So it makes no arrays but on the stack,
    see `stack_arrays`.
    """
    return _compiled(function, {**OPTIONS, "_nrt": False})


def allocating_kernel(function: Callable[Parameters, Returned]) -> Callable[Parameters, Returned]:
    """A `kernel` that may make arrays of any size."""
    return _compiled(function, OPTIONS)


def _compiled(
    function: Callable[Parameters, Returned], options: dict[str, Any]
) -> Callable[Parameters, Returned]:
    """The compiled function, cached by the content of its file and of all files that it imports.

    Numba's key is the file alone: a caller would keep old machine code of a callee that was edited
    in another file.
    """
    settings: Any = config  # its attributes are set as it is loaded
    given = settings.CACHE_DIR
    settings.CACHE_DIR = given or str(kernel_folder(function.__code__.co_filename))
    try:
        compiled: Callable[Parameters, Returned] = njit(**options)(function)
    finally:
        settings.CACHE_DIR = given
    return compiled


def in_parallel(
    count: int, kernel: Callable[..., None], *args: object, first: int = 0, least: int = 2000
) -> None:
    """Call a compiled `kernel(start, stop, *args)` over `count` items from `first` on.

    From `least` items on it is called in threads.
    """
    workers = min(os.cpu_count() or 1, 8) if count >= least else 1
    if workers == 1:
        kernel(first, first + count, *args)
        return
    kernel(first, first, *args)
    edges = [first + count * w // workers for w in range(workers + 1)]
    with ThreadPoolExecutor(workers) as pool:
        for job in [pool.submit(kernel, edges[w], edges[w + 1], *args) for w in range(workers)]:
            job.result()


def is_cached(compiled: Any) -> bool:
    """Whether some version of a kernel is in the cache on disk; true where that cannot be told."""
    try:
        folder, name = compiled._cache.cache_path, compiled.py_func.__name__
    except AttributeError:
        return True
    return any(Path(folder).glob(f"*.{name}-*.nbi"))


@contextmanager
def second_process(module: str, wanted: bool) -> Iterator[None]:
    """Run `python -m module` beside the block, and wait for it.

    Only if it is wanted and there is a processor for it.
    """
    process = None
    if wanted and (os.cpu_count() or 1) > 1 and sys.executable:
        command = [sys.executable, "-W", "ignore", "-m", module]
        quiet = subprocess.DEVNULL
        try:
            process = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet)
        except OSError:
            process = None
    try:
        yield
    except BaseException:
        # An error or an interruption is not to wait for what nobody will call.
        if process is not None:
            process.kill()
        raise
    finally:
        if process is not None:
            try:
                process.wait(timeout=WAIT)
            except subprocess.TimeoutExpired:
                process.kill()
