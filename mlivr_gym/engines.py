"""Engines: what computes many runs at once, as an executor of `concurrent.futures`."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing import active_children, get_context, resource_tracker
from typing import Any

from mlivr_gym._interrupts import block
from mlivr_gym.errors import SettingError
from mlivr_gym.extras import require

ENGINES = ("local", "dask")
"""Processes of this machine, or Dask: a scheduler with workers on any number of machines."""

RETRIES = 3
"""How often Dask computes a block again whose worker has ended."""


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
        resource_tracker.ensure_running()  # which unblocks Ctrl-C in some versions of Python
        block()
        others = active_children()
        with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
            try:
                yield pool
            except BaseException:
                for process in active_children():
                    if process not in others:  # it would finish its block
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
            cluster: Any = LocalCluster(n_workers=count, threads_per_worker=1, **quiet)
            stack.enter_context(cluster)
        try:
            client = stack.enter_context(Client(scheduler or cluster))
        except (OSError, ValueError) as error:
            raise SettingError(f"no Dask scheduler at {scheduler!r}: {error}") from None
        notify(client.dashboard_link)
        yield client.get_executor(retries=RETRIES, pure=False)
