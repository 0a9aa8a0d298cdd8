"""Plans as plain data: written to JSON, and read with a check of every field."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np

from mlivr_gym.compiled.bit_sets import BRANCHES
from mlivr_gym.errors import PlanError, shortened
from mlivr_gym.files import checksum
from mlivr_gym.motion.plan_parts import (
    SWING_KINDS,
    Motion,
    Query,
    Statistics,
    Step,
    World,
)
from mlivr_gym.robot.validators import FARTHEST_TURN
from mlivr_gym.schema import (
    NAME,
    Anything,
    Choice,
    FieldPath,
    Fields,
    Integer,
    ListOf,
    Numbers,
    Struct,
    Tuples,
)
from mlivr_gym.settings import GRAPH_RULES, check_rules
from mlivr_gym.values import MAX_LENGTH, MAX_PARTS

FORMAT = 6
"""Version of the file format."""

UNIT_TOLERANCE = 1e-6
"""Largest deviation of the norm of a quaternion from 1."""

MAX_STANCES = 10_000
"""Upper bound of the stances of a plan that is read; a walk through the JEM and back has about
twenty."""

QUERY = Struct.of(Query, complete=True)
"""Schema of the fields of a `Query`."""

WORLD = Struct.of(World, complete=True)
"""Schema of the fields of a `World`."""

STATISTICS = Struct.of(Statistics, complete=True)
"""Schema of the fields of `Statistics`."""

PLAN_FILE = Fields(
    {
        "format": Anything(),
        "rules": Anything(),
        "query": QUERY,
        "world": WORLD,
        "motion": Anything(),
        "statistics": STATISTICS,
    },
    {"checksum": NAME},
)
"""Schema of a plan file; the schema of its motion depends on the robot, see `motion_fields`."""


def step_fields(limbs: int) -> Struct[Step]:
    """Return the schema of the fields of a `Step` for a robot with `limbs` limbs."""
    return Struct(
        Step,
        {
            "limb": Integer(0, limbs - 1),
            "from_point": NAME,
            "to_point": NAME,
            "leader": Integer(0, limbs - 1),
            "displacement": Tuples((), 0.0),
            "swing": Choice(SWING_KINDS),
            "rests": ListOf(Integer(0, MAX_PARTS), 0, MAX_PARTS),
            "knots": Numbers(
                (None, limbs, 6), -FARTHEST_TURN, FARTHEST_TURN, "rad", (0, MAX_PARTS)
            ),
        },
        complete=True,
    )


def motion_fields(stances: int, limbs: int) -> Struct[Motion]:
    """Return the schema of the fields of a `Motion` with `stances` stances.

    It bounds everything that a kernel uses as an index.
    """
    return Struct(
        Motion,
        {
            "stances": ListOf(ListOf(NAME, limbs, limbs), 1, MAX_STANCES),
            "steps": ListOf(step_fields(limbs), stances - 1, stances - 1),
            "base_positions": Numbers((stances, 3), most=MAX_LENGTH, unit="m"),
            "base_quaternions": Numbers((stances, 4), -1.001, 1.001),
            "joint_positions": Numbers((stances, limbs, 6), -FARTHEST_TURN, FARTHEST_TURN, "rad"),
            "branches": ListOf(ListOf(Integer(0, BRANCHES - 1), limbs, limbs), stances, stances),
            "w_m": Numbers((stances, limbs)),
            "w_b": Numbers((stances,)),
        },
    )


def plan_data(query: Query, world: World, motion: Motion, statistics: Statistics) -> dict[str, Any]:
    """Return the parts of a plan as plain data for JSON."""
    data = {"format": FORMAT, "rules": GRAPH_RULES, "query": asdict(query)}
    data["world"] = {
        "map_name": world.map_name, "map_fingerprint": world.map_fingerprint,
        "obstacles": [box.to_dict() for box in world.obstacles],
        "occupied": list(world.occupied), "robot": world.robot.to_dict(),
        "settings": asdict(world.settings),
    }  # fmt: skip
    values = {field.name: getattr(motion, field.name) for field in fields(motion)}
    data["motion"] = _listed(values) | {"steps": [_listed(vars(step)) for step in motion.steps]}
    data["statistics"] = asdict(statistics)
    return data | {"checksum": checksum(data)}


def _listed(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values with lists in place of arrays."""
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in values.items()}


def read_parts(data: Any) -> tuple[Query, World, Motion, Statistics]:
    """Read the parts of a plan from plain data.

    Raises a `PlanError` if the data has another format or other graph rules, or a field is missing,
    unknown or invalid; the message names it.
    """
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        given = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise PlanError(f"not a plan of format {FORMAT}: its format is {shortened(given)}")
    check_rules("the plan", data.get("rules"), "plan it anew", PlanError)
    parts = PLAN_FILE.read(data, FieldPath("", PlanError))
    motion = _motion(parts["motion"], parts["world"].robot.limbs)
    return parts["query"], parts["world"], motion, parts["statistics"]


def _motion(data: Any, limbs: int) -> Motion:
    """Read the motion of a plan for a robot with `limbs` limbs."""
    place = FieldPath("motion", PlanError)
    listed = Fields({"stances": ListOf(Anything(), 1, MAX_STANCES)}, others=True).read(data, place)
    motion = motion_fields(len(listed["stances"]), limbs).read(data, place)
    lengths = np.linalg.norm(motion.base_quaternions, axis=1)
    wrong = int(np.abs(lengths - 1.0).argmax())
    if abs(lengths[wrong] - 1.0) > UNIT_TOLERANCE:
        quaternion = place.field("base_quaternions").entry(wrong)
        raise quaternion.fault(f"has length {lengths[wrong]:g}; it must be 1")
    _check_order(motion.stances, motion.steps)
    for i, step in enumerate(motion.steps):
        _check_joint_path(place.field("steps").entry(i), step)
    return replace(motion, branches=np.array(motion.branches, dtype=np.int64))


def _check_joint_path(place: FieldPath, step: Step) -> None:
    """Check that knots and rests of a step are those of a joint path, or left out.

    A joint path has a departure, an approach, and a swing of one part or more.
    """
    if step.leader == step.limb:
        raise place.field("leader").fault(f"is {step.leader}, the limb that moves")
    if len(step.knots) or step.rests or step.swing != "unchecked":
        rests, rising = step.rests, all(a < b for a, b in pairwise(step.rests))
        if len(rests) < 4 or not rising or (rests[0], rests[-1]) != (0, len(step.knots) - 1):
            raise place.field("rests").fault(
                f"must rise from 0 to {len(step.knots) - 1}, the number of the last knot, by three "
                f"segments or more, not {shortened(list(rests))}"
            )


def _check_order(stances: tuple[tuple[str, ...], ...], steps: tuple[Step, ...]) -> None:
    """Check that each step leads from its stance to the next one."""
    for i, (before, step, after) in enumerate(zip(stances[:-1], steps, stances[1:], strict=True)):
        reached = tuple(
            step.to_point if limb == step.limb else point for limb, point in enumerate(before)
        )
        if before[step.limb] != step.from_point or reached != after:
            raise PlanError(
                f"motion.steps[{i}] does not lead from motion.stances[{i}] to the next: limb "
                f"{step.limb} moves from {step.from_point!r} to {step.to_point!r}, and the stances "
                f"are {before} and {after}"
            )
