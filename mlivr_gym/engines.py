"""Engines: what computes many runs at once, as an executor of `concurrent.futures`."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing import active_children, resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from mlivr_gym.errors import SettingError
from mlivr_gym.extras import require

ENGINES = ("local", "dask")
"""Processes of this machine, or Dask: a scheduler with workers on any number of machines."""

RETRIES = 3
"""How often Dask computes a block again whose worker has ended."""


@contextmanager
def _not_interrupted() -> Iterator[None]:
    """Start processes to which Ctrl-C is not passed on, since each would print where it was.

    They inherit the blocked signal; one that comes meanwhile waits.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    resource_tracker.ensure_running()  # which unblocks the signal when it starts
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Worker(SpawnProcess):
    """A process of a pool."""

    def start(self) -> None:
        """Start it."""
        with _not_interrupted():
            super().start()


class _Workers(SpawnContext):
    """How the processes of a pool are started."""

    Process = _Worker


@contextmanager
def executor_of(
    engine: str | Executor,
    workers: int | None,
    scheduler: str | None = None,
    notify: Callable[[str], None] = print,
) -> Iterator[Executor]:
    """Yield an executor: one of `ENGINES`, or one that is given, which stays open.

    There is one process for each core unless a number of workers is given. The scheduler of Dask is
    started on this machine unless an address is given; `notify` is called with the address of its
    dashboard. Raises a `SettingError` if Dask is not installed, or its scheduler does not answer.
    """
    if isinstance(engine, Executor):
        yield engine
        return
    count = workers or os.cpu_count() or 1
    if engine == "local":
        with ProcessPoolExecutor(count, mp_context=_Workers()) as pool:
            try:
                yield pool
            except BaseException:
                for process in active_children():
                    if isinstance(process, _Worker):  # it would finish its block
                        process.terminate()
                raise
            finally:
                pool.shutdown(cancel_futures=True)
        return
    require("dask", "distributed", extra="study")
    from dask.distributed import Client, LocalCluster

    with ExitStack() as stack:
        if scheduler is None:
            quiet = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL}
            with _not_interrupted():
                cluster: Any = LocalCluster(n_workers=count, threads_per_worker=1, **quiet)
            stack.enter_context(cluster)
        try:
            client = stack.enter_context(Client(scheduler or cluster))
        except (OSError, ValueError) as error:
            raise SettingError(f"no Dask scheduler at {scheduler!r}: {error}") from None
        notify(client.dashboard_link)
        yield client.get_executor(retries=RETRIES, pure=False)
