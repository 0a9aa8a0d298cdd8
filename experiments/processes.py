"""Work over many seeds in several processes, kept answer by answer: a run that ends goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm


class Processes(NamedTuple):
    """How many processes, and where their answers stay."""

    workers: int
    keep: Path | None = None
    """Folder with a file of answers for each study; they hold for the code they were made with."""

    def answers(self, work: Callable[[int], Any], seeds: range, what: str) -> Iterator[Any]:
        """Answers for all seeds, in order, as plain data; those that are kept are not made again.

        Parameters
        ----------
        work
            What is done for a seed; it takes what it needs from the process it is forked of.
        seeds
            The seeds.
        what
            Name of the study, and of its file.
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
