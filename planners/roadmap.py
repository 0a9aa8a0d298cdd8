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

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.cache import cache_folder
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError
from mlivr_gym.files import write_whole
from mlivr_gym.planners.label_search import Roads
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.stance_sets import key_of

FORMAT = 1
"""Format of the files."""


SHIPPED = ("mlivr3", "mlivr4")
"""Robots whose roadmaps on the JEM ship with the package."""


class RoadmapError(MlivrError):
    """A roadmap cannot be built or read."""


@dataclass(frozen=True)
class Roadmap:
    """Stances that are known to be joined by steps.

    Attributes:
        key: Digest of map, robot and settings, see `key_of`.
        points: Point index of each limb, in the order of `codes`, shape (n, N).
        base_position: Base positions [m], shape (n, 3).
        released: Masks on which each limb can be released, shape (n, N).
        pairs: Stances that a step joins, in both directions, shape (p, 2).
        kept: Masks that the limbs which hold keep on it, 0 for the one that moves, shape (p, N) of
            any kind of whole number.
        odds: Weights of `step_odds.features`, which tell likely steps from others.
    """

    key: str
    points: IntArray
    base_position: Array
    released: IntArray
    pairs: IntArray
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
        code = codes(stances)
        row = np.minimum(np.searchsorted(self._codes, code), len(self) - 1)
        found: IntArray = np.where(self._codes[row] == code, row, -1)
        return found

    @cached_property
    def roads(self) -> Roads:
        """The steps in both directions, by the stance that they leave."""
        a, b = self.pairs.T
        apart, limb = self._codes[a] ^ self._codes[b], np.zeros(len(a), dtype=np.uint8)
        for i in range(1, self.points.shape[1]):
            limb += (apart >> np.uint64(16 * i)) > 0
        able = (self.released[a, limb] != 0) & (self.released[b, limb] != 0)
        a, b, limb, kept = a[able], b[able], limb[able], self.kept[able]
        source, other = np.concatenate([a, b]), np.concatenate([b, a])
        order = np.argsort(source, kind="stable")
        source, other, pair = source[order], other[order], order % len(a)
        limb, kept = limb[pair], np.take(kept, pair, axis=0)
        kept[np.arange(len(kept)), limb] = self.released[other, limb]
        start = np.searchsorted(source, np.arange(len(self) + 1))
        return Roads(
            start.astype(np.int32), other.astype(np.int32), limb, kept.astype(np.uint16),
            self.released.astype(np.uint16),
        )  # fmt: skip

    def write(self, path: str | Path) -> None:
        """Write the roadmap.

        Raises:
            FileError: If the file cannot be written.
        """
        every, buffer = one_limb_apart(self.points), io.BytesIO()
        joined = np.isin(_numbers(every, len(self)), _numbers(self.pairs, len(self)))
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
                found["released"].astype(np.int64), _pairs(every[joined], len(points)), kept,
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


def one_limb_apart(points: IntArray) -> IntArray:
    """Pairs of stances that differ in the point of one limb, in order, shape (p, 2).

    Args:
        points: Stances in the order of their codes, shape (n, N).
    """
    return _pairs(_numbers_one_limb_apart(points), len(points))


def _numbers_one_limb_apart(points: IntArray) -> IntArray:
    """The numbers of the pairs of `one_limb_apart`, shape (p,)."""
    numbers = [np.zeros(0, dtype=np.int64)]
    for limb in range(points.shape[1]):
        rest = codes(np.delete(points, limb, axis=1))
        order = np.argsort(rest, kind="stable")
        held, apart = rest[order], 1
        while True:
            same = np.flatnonzero(held[apart:] == held[:-apart])
            if not len(same):
                break
            numbers.append(order[same] * len(points) + order[same + apart])
            apart += 1
    every: IntArray = np.concatenate(numbers)
    every.sort()
    return every


def _pairs(numbers: IntArray, count: int) -> IntArray:
    """The pairs of some numbers, see `_numbers`, shape (p, 2)."""
    pairs: IntArray = np.stack(np.divmod(numbers, count), axis=1)
    return pairs


def _numbers(pairs: IntArray, count: int) -> IntArray:
    """One number for each pair of `count` stances, in their order, shape (p,)."""
    numbers: IntArray = pairs[:, 0] * count + pairs[:, 1]
    return numbers
