"""Processes that share the work of building tables, and report their progress."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, wait
from multiprocessing import get_context, parent_process
from typing import Any

Progress = Callable[[float], None]
"""Called with the finished share of the work."""


class Stopped(Exception):
    """Raised in a process whose work is not needed any more."""


class Workers:
    """Processes that report their progress."""

    def __init__(self, count: int, stages: int, progress: Progress | None) -> None:
        """Start processes, or none if `count` is 1: the work is then done in this process.

        The finished share is reported over as many stages, each a call of `run` or `next_stage`.
        """
        self.count, self.stages, self.progress, self.stage = count, stages, progress, 0
        self.pool: ProcessPoolExecutor | None = None
        if count == 1:
            _start_worker(_SingleProcess(self))
            return
        context = get_context("spawn")
        # The finished share of each process, and whether they are to stop.
        self.shares: Any = context.Array("d", count + 1)
        self.pool = ProcessPoolExecutor(
            count, mp_context=context, initializer=_start_worker, initargs=(self.shares,)
        )

    def __enter__(self) -> Workers:
        """Return the processes."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the processes; after an error as soon as they report."""
        if self.pool is not None:
            self.shares[self.count] = float(kind is not None)
            self.pool.shutdown(cancel_futures=True)

    def run(self, work: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Return the results of `work` for each of some arguments, which make up one stage."""
        if self.pool is None:
            found = [work(k, *given) for k, given in enumerate(arguments)]
            self.next_stage()
            return found
        for k in range(self.count):
            self.shares[k] = 0.0
        jobs = [self.pool.submit(work, k, *given) for k, given in enumerate(arguments)]
        waiting: Any = jobs
        while waiting:
            _, waiting = wait(waiting, timeout=0.5)
            self.report(sum(self.shares[: self.count]) / self.count)
        self.next_stage()
        return [job.result() for job in jobs]

    def report(self, share: float) -> None:
        """Report the finished share of a stage."""
        if self.progress is not None:
            self.progress((self.stage + share) / self.stages)

    def next_stage(self) -> None:
        """Go on to the next stage."""
        self.stage += 1


class _SingleProcess:
    """Stand-in for the shared array if there is a single process: reports at once."""

    def __init__(self, workers: Workers) -> None:
        self.workers = workers

    def __getitem__(self, _: int) -> float:
        return 0.0

    def __setitem__(self, _: int, share: float) -> None:
        self.workers.report(share)


_shares: Any = None
"""In a worker, the finished share of each of them, and last whether they are to stop."""


def _start_worker(shares: Any) -> None:
    """Store the shares to which a worker process reports."""
    global _shares
    _shares = shares


def report_share(worker: int, share: float) -> None:
    """Report, in a worker, the finished share of its part of a stage.

    Raises `Stopped` if the remaining work is not needed any more.
    """
    _shares[worker] = share
    parent = parent_process()
    if parent is not None and not parent.is_alive():  # it was killed, so results are lost
        os._exit(1)
    if _shares[-1]:
        raise Stopped
