"""A roadmap: stances of many limbs that are known to be nodes, and the steps that join them.

It is a part of the stance graph that was worked out beforehand, with the branches that each step
keeps, so that a walk over it is found as with the tables of two limbs. A query joins its start to
it, see `first_walk`. No plan rests on it: every step of a walk is checked anew on the graph.
"""

from __future__ import annotations

import io
import logging
import zipfile
import zlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.cache import cache_folder
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError
from mlivr_gym.files import write_whole
from mlivr_gym.planners.label_search import Roads
from mlivr_gym.postures.turns import lowest_first, turned
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.stance_sets import key_of

FORMAT = 2
"""Format of the files."""


SHIPPED = ("mlivr3", "mlivr4")
"""Robots whose roadmaps on the JEM ship with the package."""


class RoadmapError(MlivrError):
    """A roadmap cannot be built or read."""


class Pairs(NamedTuple):
    """Pairs of stances that differ in the point of one limb, the robot turned as it may be."""

    rows: NDArray[np.int32]
    """The two stances, shape (p, 2)."""
    limbs: NDArray[np.int8]
    """The limb of each that holds another point, shape (p, 2)."""

    def take(self, index: Any) -> Pairs:
        """The chosen pairs."""
        return Pairs(self.rows[index], self.limbs[index])

    @property
    def turns(self) -> IntArray:
        """Turns that put the limbs of the first stance in the places of the second, (p,)."""
        turns: IntArray = np.subtract(self.limbs[:, 0], self.limbs[:, 1], dtype=np.int64)
        return turns

    def stances_after(self, points: IntArray) -> IntArray:
        """The second stances with the limbs of the first, shape (p, N)."""
        return turned(points[self.rows[:, 1]], -self.turns)


@dataclass(frozen=True)
class Roadmap:
    """Stances that are known to be joined by steps.

    A stance stands for those of the robot after turns, see `turns`: limb 0 holds its lowest point.

    Attributes:
        key: Digest of map, robot and settings, see `key_of`.
        points: Point index of each limb, in the order of `codes`, shape (n, N).
        base_position: Base positions [m], shape (n, 3).
        released: Masks on which each limb can be released, shape (n, N).
        pairs: Stances that a step joins, in both directions.
        kept: Masks that the limbs of the first stance which hold keep on it, 0 for the one that
            moves, shape (p, N) of any kind of whole number.
        odds: Weights of `step_odds.features`, which tell likely steps from others.
    """

    key: str
    points: IntArray
    base_position: Array
    released: IntArray
    pairs: Pairs
    kept: IntArray
    odds: Array

    def __len__(self) -> int:
        """Number of stances."""
        return len(self.points)

    @cached_property
    def _codes(self) -> NDArray[np.uint64]:
        return codes(self.points)

    def find(self, stances: IntArray) -> IntArray:
        """Rows of stances, shape (k, N) -> (k,); -1 for those that it does not have."""
        code = codes(turned(stances, lowest_first(stances)))
        row = np.minimum(np.searchsorted(self._codes, code), len(self) - 1)
        found: IntArray = np.where(self._codes[row] == code, row, -1)
        return found

    @cached_property
    def roads(self) -> Roads:
        """The steps in both directions, by the stance that they leave."""
        (a, b), (i, j) = self.pairs.rows.T, self.pairs.limbs.T
        able = (self.released[a, i] != 0) & (self.released[b, j] != 0)
        a, b, i, j, kept = a[able], b[able], i[able], j[able], self.kept[able]
        limbs, released = self.points.shape[1], self.released.astype(np.uint16)
        source, other = np.concatenate([a, b]), np.concatenate([b, a])
        order = np.argsort(source, kind="stable")
        limb, turn = np.concatenate([i, j])[order], np.concatenate([i - j, j - i])[order] % limbs
        kept = np.concatenate([kept, turned(kept, i - j)]).astype(np.uint16, copy=False)
        kept, source, other = np.take(kept, order, axis=0), source[order], other[order]
        kept[np.arange(len(kept)), limb] = released[other, (limb - turn) % limbs]
        start = np.searchsorted(source, np.arange(len(self) + 1))
        return Roads(
            start.astype(np.int32), other, limb.astype(np.uint8), turn.astype(np.uint8), kept,
            released,
        )  # fmt: skip

    def write(self, path: str | Path) -> None:
        """Write the roadmap.

        Raises:
            FileError: If the file cannot be written.
        """
        every, buffer = _numbers_one_limb_apart(self.points), io.BytesIO()
        joined = np.isin(every, _numbers(self.pairs, self.points))
        np.savez_compressed(
            buffer,
            format=FORMAT,
            key=self.key,
            points=self.points.astype(np.uint16),
            base_position=self.base_position.astype(np.float32),
            released=self.released.astype(np.uint16),
            joined=np.packbits(joined),
            kept=self.kept.astype(np.uint16),
            odds=self.odds,
        )
        write_whole(path, buffer.getvalue())

    @classmethod
    def read(cls, path: str | Path) -> Roadmap:
        """The roadmap in a file.

        Raises:
            RoadmapError: If it is none of this format.
        """
        try:
            with Path(path).open("rb") as stream, np.load(stream) as data:
                found = {name: data[name] for name in data.files}
            if int(found.pop("format")) != FORMAT:
                raise ValueError
            points = found["points"].astype(np.int64)
            every = _numbers_one_limb_apart(points)
            joined = np.unpackbits(found.pop("joined"), count=len(every)).view(np.bool_)
            kept = found["kept"]
            if len(kept) != int(joined.sum()):
                raise ValueError
            return cls(
                str(found["key"]), points, found["base_position"].astype(np.float64),
                found["released"].astype(np.int64), _pairs(every[joined], points), kept,
                found["odds"],
            )  # fmt: skip
        except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
            raise RoadmapError(f"{str(path)!r} is no roadmap of format {FORMAT}") from None

    @classmethod
    def of(cls, graph: StanceGraph) -> Roadmap | None:
        """The roadmap that was built for a graph, or ships with the package; None without one.

        One that cannot be read is passed over with a warning.
        """
        for path in filter(Path.is_file, roadmap_files(graph)):
            try:
                found = _read(path, path.stat().st_mtime_ns)
            except RoadmapError as error:
                logging.getLogger(__name__).warning("%s", error)
                continue
            if found.key == key_of(graph):
                return found
        return None


@lru_cache(maxsize=4)
def _read(path: Path, _: int) -> Roadmap:
    """The roadmap in a file as it was changed last, kept for further planners."""
    return Roadmap.read(path)


def roadmap_files(graph: StanceGraph) -> list[Path]:
    """Where the roadmap of a graph may be: the one that was built, and the one that ships."""
    folder, name = cache_folder(), graph.robot.name
    built = [] if folder is None else [folder / f"roadmap-{key_of(graph)}.npz"]
    return built + [asset_path(f"roadmap-{name}.npz")] * (name in SHIPPED)


def codes(stances: IntArray) -> NDArray[np.uint64]:
    """One number for each stance, in the order of its points from the last limb, (k, N) -> (k,)."""
    # Points of 16 bits each: four limbs fill a number.
    code = np.zeros(len(stances), dtype=np.uint64)
    for limb in reversed(range(stances.shape[1])):
        code = (code << np.uint64(16)) | stances[:, limb].astype(np.uint64)
    return code


def one_limb_apart(points: IntArray) -> Pairs:
    """Pairs of stances that differ in the point of one limb, the robot turned as it may be.

    Args:
        points: Stances, of which the lowest point is the first, in the order of their codes,
            shape (n, N).

    Returns:
        The pairs in order, the row of the first stance below that of the second.
    """
    return _pairs(_numbers_one_limb_apart(points), points)


def _numbers_one_limb_apart(points: IntArray) -> NDArray[np.int64]:
    """The numbers of the pairs of `one_limb_apart`, shape (p,)."""
    limbs = points.shape[1]
    # What the others hold, in turn from the limb on that moves.
    turns = np.tile(np.arange(limbs), len(points))
    rest = codes(turned(np.repeat(points, limbs, axis=0), turns)[:, 1:])
    order = np.argsort(rest, kind="stable")
    held, apart = rest[order], 1
    numbers = [np.zeros(0, dtype=np.int64)]
    while True:
        same = np.flatnonzero(held[apart:] == held[:-apart])
        if not len(same):
            break
        numbers.append(order[same] * len(rest) + order[same + apart])
        apart += 1
    every: IntArray = np.concatenate(numbers)
    every.sort()
    return every


def _pairs(numbers: IntArray, points: IntArray) -> Pairs:
    """The pairs of some numbers, see `_numbers`."""
    ends = np.empty((len(numbers), 2), dtype=np.int32)
    ends[:, 0], ends[:, 1] = np.divmod(numbers, points.size)
    rows, limbs = np.divmod(ends, np.int32(points.shape[1]))
    return Pairs(rows, limbs.astype(np.int8))


def _numbers(pairs: Pairs, points: IntArray) -> IntArray:
    """One number for each pair of stances, in their order, shape (p,)."""
    ends = pairs.rows.astype(np.int64) * points.shape[1] + pairs.limbs
    numbers: IntArray = ends[:, 0] * points.size + ends[:, 1]
    return numbers
