"""Design of a study: which runs it has, by factors and their levels.

A full factorial design: the runs are all combinations of the levels of the factors (Fisher 1935),
each with the same number of random tasks. The task of a run depends on the seed, its number, and
the factors of the graph alone, so that costs are compared on equal tasks.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from mlivr_gym.arguments import Reader, checked
from mlivr_gym.errors import MlivrError, SettingError, path_shown
from mlivr_gym.files import FileError
from mlivr_gym.motion import COSTS
from mlivr_gym.schema import (
    Choice,
    FieldPath,
    Fields,
    Flag,
    Integer,
    ListOf,
    Text,
    Tuples,
    Validator,
)
from mlivr_gym.values import MAX_PARTS

BLOCK_TASKS = 25
"""Maximum number of runs of a block, which one process computes and one file stores."""

FUNCTION_BLOCKS = 40
"""Number of blocks into which the tasks of a function are divided, while blocks are not full."""

GRAPH_FACTORS: dict[str, tuple[Validator[Any], Any]] = {
    "robot": (Text(), "mlivr2"),
    "map": (Text(), "jem"),
    "limb_threshold": (Tuples((), 0.0, 1.0), 0.1),
    "base_threshold": (Tuples((), 0.0, 1.0), None),
    "clearance": (Tuples((), 0.0, 0.5, "m"), 0.02),
    "collisions": (Flag(), True),
}
"""Validator and default level of the factors that determine the stance graph."""

FACTORS: dict[str, tuple[Validator[Any], Any]] = GRAPH_FACTORS | {
    "occupied": (Tuples((), 0.0, 0.9), 0.0),
    "cost": (Choice(tuple(name for name in COSTS if name != "weighted")), "steps"),
    "time_limit": (Tuples((), 0.01, 86_400.0, "s"), 60.0),
}
"""Those of a study of plans. Each task occupies its own random points, the share `occupied` of the
map; the time limit [s] is of effect with more than two limbs."""


def is_function(kind: str) -> bool:
    """Return whether a kind is a function of the user, given as `"module:function"`."""
    return ":" in kind


def _level(value: object, place: FieldPath) -> object:
    """Return a level of a factor of a function."""
    if not isinstance(value, str | int | float):
        raise place.refused(value, "text, a number, or true or false")
    return value


def _validators(kind: str, data: object, place: FieldPath) -> dict[str, Validator[Any]]:
    """Return the validator of a level of each factor that a kind has, or a function is given."""
    if is_function(kind):
        factors = data.get("factors") if isinstance(data, Mapping) else None
        return dict.fromkeys(factors, Reader(_level)) if isinstance(factors, Mapping) else {}
    Choice(("plan",)).read(kind, place.field("kind"))
    return {name: validator for name, (validator, _) in FACTORS.items()}


class RunBlock(NamedTuple):
    """Runs that are computed together: successive tasks of one combination of levels."""

    number: int
    """Number of the block."""
    first_run: int
    """Number of its first run."""
    levels: dict[str, Any]
    """The level of each factor."""
    tasks: range
    """Numbers of its tasks."""


@dataclass(frozen=True)
class StudyDesign:
    """The runs of a study."""

    kind: str
    """What a run does: `"plan"` plans a task; `"module:function"` calls a function with the number
    of the task and the level of each factor by its name, which returns the columns of a row."""
    factors: Mapping[str, tuple[Any, ...]]
    """Levels of each factor that the study varies or sets; others have their default level."""
    tasks: int = 20
    """Number of random tasks for each combination of levels."""
    seed: int = 0
    """Seed of the tasks."""

    @classmethod
    def from_data(cls, data: object) -> StudyDesign:
        """Return the design that plain data describe, as a TOML file holds them.

        Raises an `MlivrError` if a field is faulty; the message names it, its value and what would
        be valid.
        """
        place = FieldPath("", SettingError)
        sizes = {"tasks": Integer(1, 10**6), "seed": Integer(0, 2**31)}
        kind: dict[str, Validator[Any]] = {"kind": Text()}
        read = Fields(kind, sizes, others=True).read(data, place)
        known = _validators(read["kind"], data, place)
        levels = {name: ListOf(one, least=1, most=MAX_PARTS) for name, one in known.items()}
        read = Fields(kind, sizes | {"factors": Fields({}, levels)}).read(data, place)
        for name, given in read.get("factors", {}).items():
            if len(set(given)) < len(given):
                raise place.field(f"factors.{name}").refused(list(given), "levels that differ")
        return cls(**({"factors": {}} | read))

    @classmethod
    @checked()
    def from_file(cls, path: str | Path) -> StudyDesign:
        """Return the design that a TOML file describes.

        Raises an `MlivrError` if the file cannot be read, or a field is faulty.
        """
        try:
            data = tomllib.loads(Path(path).read_text("utf-8"))
        except RecursionError:
            raise FileError(
                f"cannot read study {path_shown(path)}: it is nested too deeply"
            ) from None
        except (OSError, ValueError) as error:  # ValueError: neither UTF-8 nor TOML
            reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
            raise FileError(f"cannot read study {path_shown(path)}: {reason}") from None
        try:
            return cls.from_data(data)
        except MlivrError as fault:
            raise SettingError(f"study {str(path)!r}: {fault}") from None

    def to_data(self) -> dict[str, Any]:
        """Return the design as plain data."""
        return asdict(self) | {"factors": {name: list(one) for name, one in self.factors.items()}}

    @property
    def combinations(self) -> list[dict[str, Any]]:
        """All combinations of levels, the last factor given varying fastest."""
        known = {} if is_function(self.kind) else FACTORS
        defaults = {name: level for name, (_, level) in known.items()}
        return [
            defaults | dict(zip(self.factors, levels, strict=True))
            for levels in product(*self.factors.values())
        ]

    @property
    def blocks(self) -> list[RunBlock]:
        """The blocks of the study, in the order of their runs."""
        found: list[RunBlock] = []
        size = BLOCK_TASKS
        if is_function(self.kind):
            size = min(size, -(-self.tasks // FUNCTION_BLOCKS))
        for k, levels in enumerate(self.combinations):
            for begin in range(0, self.tasks, size):
                tasks = range(begin, min(begin + size, self.tasks))
                found.append(RunBlock(len(found), k * self.tasks + begin, levels, tasks))
        return found
