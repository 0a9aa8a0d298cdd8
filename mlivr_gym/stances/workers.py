"""Processes that share the work of building tables, and tell how far they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, wait
from multiprocessing import get_context
from typing import Any

Progress = Callable[[float], None]
"""Called with the share of the work that is done."""


class Workers:
    """Processes that tell how far they are."""

    def __init__(self, count: int, stages: int, progress: Progress | None) -> None:
        """Start some; of one none: the work is done where it is asked for, and nothing told of it.

        Args:
            count: Number of processes.
            stages: How often they are run.
            progress: Called with the share of all stages that is done.
        """
        self.count, self.stages, self.progress, self.stage = count, stages, progress, 0
        self.pool: ProcessPoolExecutor | None = None
        if count == 1:
            self.shares: Any = [0.0]
            _start_worker(self.shares)
            return
        context = get_context("spawn")
        self.shares = context.Array("d", count)
        self.pool = ProcessPoolExecutor(
            count, mp_context=context, initializer=_start_worker, initargs=(self.shares,)
        )

    def __enter__(self) -> Workers:
        """Themselves."""
        return self

    def __exit__(self, *_: object) -> None:
        """End them."""
        if self.pool is not None:
            self.pool.shutdown(cancel_futures=True)

    def run(self, work: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """What `work` returns for each of some arguments: one stage."""
        if self.pool is None:
            return [work(k, *given) for k, given in enumerate(arguments)]
        for k in range(self.count):
            self.shares[k] = 0.0
        jobs = [self.pool.submit(work, k, *given) for k, given in enumerate(arguments)]
        waiting: Any = jobs
        while waiting:
            _, waiting = wait(waiting, timeout=0.5)
            if self.progress is not None:
                self.progress((self.stage + sum(self.shares) / self.count) / self.stages)
        self.skip()
        return [job.result() for job in jobs]

    def skip(self) -> None:
        """Pass over a stage."""
        self.stage += 1


_shares: Any = None
"""In a worker, how far each of them is."""


def _start_worker(shares: Any) -> None:
    global _shares
    _shares = shares


def tell(worker: int, share: float) -> None:
    """Tell, in a worker, which share of its part of a stage is done."""
    _shares[worker] = share
