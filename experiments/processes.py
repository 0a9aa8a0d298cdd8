"""Evaluate a function for many seeds in parallel, with stored results so that a run can resume."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm


class Processes(NamedTuple):
    """A number of worker processes, and a folder in which their results are stored."""

    workers: int
    """Number of processes."""
    keep: Path | None = None
    """Folder with one file of results for each study; they are valid for the code that made
    them."""

    def answers(self, work: Callable[[int], Any], seeds: range, what: str) -> Iterator[Any]:
        """Yield the results for all seeds in order, as plain data.

        Stored results are not computed again. `work` is called with a seed and may use global data
        that exist before the processes are forked. `what` is the name of the study and of its file.
        """
        path = None if self.keep is None else self.keep / f"{what.replace(' ', '_')}.jsonl"
        known: dict[int, Any] = {}
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            for line in path.read_text().splitlines() if path.exists() else ():
                seed, answer = json.loads(line)
                known[seed] = answer
        todo = [seed for seed in seeds if seed not in known]
        with ProcessPoolExecutor(self.workers, mp_context=get_context("fork")) as pool:
            done = pool.map(work, todo, chunksize=1)
            for seed in tqdm(seeds, desc=what, mininterval=5.0):
                if seed not in known:
                    line = json.dumps([seed, next(done)])
                    known[seed] = json.loads(line)[1]
                    if path is not None:
                        with path.open("a", encoding="utf-8") as file:
                            file.write(line + "\n")
                yield known[seed]
