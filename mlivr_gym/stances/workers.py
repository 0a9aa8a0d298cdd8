"""Processes that share the work of building tables, and tell how far they are."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, wait
from multiprocessing import get_context, parent_process
from typing import Any

Progress = Callable[[float], None]
"""Called with the share of the work that is done."""


class Stopped(Exception):
    """Raised in a process whose work is not wanted any more."""


class Workers:
    """Processes that tell how far they are."""

    def __init__(self, count: int, stages: int, progress: Progress | None) -> None:
        """Start some; of one none: the work is done where it is asked for.

        Parameters
        ----------
        count
            Number of processes.
        stages
            How often they are run.
        progress
            Called with the share of all stages that is done.
        """
        self.count, self.stages, self.progress, self.stage = count, stages, progress, 0
        self.pool: ProcessPoolExecutor | None = None
        if count == 1:
            _start_worker(_Alone(self))
            return
        context = get_context("spawn")
        # How far each is, and whether they are to stop.
        self.shares: Any = context.Array("d", count + 1)
        self.pool = ProcessPoolExecutor(
            count, mp_context=context, initializer=_start_worker, initargs=(self.shares,)
        )

    def __enter__(self) -> Workers:
        """Themselves."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End them; after an error as soon as they tell something."""
        if self.pool is not None:
            self.shares[self.count] = float(kind is not None)
            self.pool.shutdown(cancel_futures=True)

    def run(self, work: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """What `work` returns for each of some arguments: one stage."""
        if self.pool is None:
            found = [work(k, *given) for k, given in enumerate(arguments)]
            self.skip()
            return found
        for k in range(self.count):
            self.shares[k] = 0.0
        jobs = [self.pool.submit(work, k, *given) for k, given in enumerate(arguments)]
        waiting: Any = jobs
        while waiting:
            _, waiting = wait(waiting, timeout=0.5)
            self.show(sum(self.shares[: self.count]) / self.count)
        self.skip()
        return [job.result() for job in jobs]

    def show(self, share: float) -> None:
        """Pass on which share of a stage is done."""
        if self.progress is not None:
            self.progress((self.stage + share) / self.stages)

    def skip(self) -> None:
        """Pass over a stage."""
        self.stage += 1


class _Alone:
    """In place of what several processes share: what is told is passed on at once."""

    def __init__(self, workers: Workers) -> None:
        self.workers = workers

    def __getitem__(self, _: int) -> float:
        return 0.0

    def __setitem__(self, _: int, share: float) -> None:
        self.workers.show(share)


_shares: Any = None
"""In a worker, how far each of them is, and last whether they are to stop."""


def _start_worker(shares: Any) -> None:
    global _shares
    _shares = shares


def tell(worker: int, share: float) -> None:
    """Tell, in a worker, which share of its part of a stage is done.

    Raises
    ------
    Stopped
        If the rest is not wanted any more.
    """
    _shares[worker] = share
    parent = parent_process()
    if parent is not None and not parent.is_alive():  # killed: nobody takes what is found
        os._exit(1)
    if _shares[-1]:
        raise Stopped
