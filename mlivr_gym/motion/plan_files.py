"""Plans as plain data: written, and read again with every field checked."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError, choice, nonnegative, shown
from mlivr_gym.kinematics.base_path import PATH_KINDS
from mlivr_gym.motion.plan_parts import (
    COSTS,
    SWING_KINDS,
    Motion,
    Query,
    Statistics,
    Step,
    World,
)
from mlivr_gym.robot.specification import FARTHEST_TURN, RobotSpec
from mlivr_gym.settings import GRAPH_RULES, Settings, check_rules
from mlivr_gym.values import LONGEST, MOST_POINTS, entries, numbers, text, whole
from mlivr_gym.world.boxes import boxes_from

FORMAT = 3
"""Version of the file format."""

BRANCHES = 8
"""Inverse-kinematics branches of a limb."""

MOST_STEPS = 10_000
"""Most steps of a plan that is read; a walk through the JEM and back takes about twenty."""

PARTS = {"query": Query, "world": World, "motion": Motion, "statistics": Statistics}
"""The parts of a plan by name."""


def plan_data(query: Query, world: World, motion: Motion, statistics: Statistics) -> dict[str, Any]:
    """The parts of a plan as plain data for JSON."""
    data = {"format": FORMAT, "rules": GRAPH_RULES, "query": asdict(query)}
    data["world"] = {
        "map_name": world.map_name, "map_fingerprint": world.map_fingerprint,
        "obstacles": [box.to_dict() for box in world.obstacles],
        "occupied": list(world.occupied), "robot": world.robot.to_dict(),
        "settings": asdict(world.settings),
    }  # fmt: skip
    values = {field.name: getattr(motion, field.name) for field in fields(motion)}
    data["motion"] = {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in values.items()
    } | {"steps": [asdict(step) for step in motion.steps]}
    data["statistics"] = asdict(statistics)
    return data


def check_form(data: Any) -> None:
    """Refuse data of another format or of other rules of the stance graph, or that lacks a field.

    Raises:
        PlanError: If it does; the message says what.
    """
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        given = data.get("format") if isinstance(data, dict) else type(data).__name__
        raise PlanError(f"not a plan of format {FORMAT}: found format {shown(given)}")
    check_rules("the plan", data.get("rules"), "plan it anew", PlanError)
    for part, record in PARTS.items():
        if not isinstance(data.get(part), dict):
            raise PlanError(f"the plan lacks {part!r}, an object")
        for name in (field.name for field in fields(record)):
            if name not in data[part]:
                raise PlanError(f"the plan lacks field {name!r} of {part!r}")


def parts_of(data: dict[str, Any]) -> tuple[Query, World, Motion, Statistics]:
    """The parts of a plan from plain data that `check_form` has passed.

    Raises:
        MlivrError: If a field is faulty; the message names it.
    """
    world = _world(data["world"])
    motion = _motion(data["motion"], world.robot.limbs)
    return _query(data["query"]), world, motion, _statistics(data["statistics"])


def _query(data: dict[str, Any]) -> Query:
    price = data["regrasp_price"]
    x, y, z = numbers(data["goal"], (3,), "goal", PlanError, LONGEST).tolist()
    return Query(
        goal=(x, y, z),
        goal_tolerance=nonnegative("goal_tolerance", data["goal_tolerance"]),
        cost_name=choice("cost_name", data["cost_name"], COSTS),
        regrasp_price=None if price is None else nonnegative("regrasp_price", price),
        method=text(data["method"], "method", PlanError),
        heuristic=text(data["heuristic"], "heuristic", PlanError),
    )


def _world(data: dict[str, Any]) -> World:
    return World(
        map_name=text(data["map_name"], "map_name", PlanError),
        map_fingerprint=text(data["map_fingerprint"], "map_fingerprint", PlanError),
        obstacles=boxes_from(data["obstacles"], "obstacle"),
        occupied=_texts(data["occupied"], "occupied"),
        robot=RobotSpec.from_dict(data["robot"]),
        settings=_settings(data["settings"]),
    )


def _motion(data: dict[str, Any], limbs: int) -> Motion:
    listed = entries(data["stances"], "stances", PlanError, MOST_STEPS)
    stances = tuple(_texts(stance, f"stances[{i}]", limbs) for i, stance in enumerate(listed))
    steps = tuple(
        _step(step, f"steps[{i}]", limbs)
        for i, step in enumerate(entries(data["steps"], "steps", PlanError, MOST_STEPS))
    )
    if not stances or len(steps) != len(stances) - 1:
        raise PlanError(f"the plan has {len(stances)} stances and {len(steps)} steps")
    _check_order(stances, steps)
    return Motion(stances=stances, steps=steps, **_arrays(data, len(stances), limbs))


def _statistics(data: dict[str, Any]) -> Statistics:
    times = ("feasibility_time", "search_time")
    return Statistics(
        nonnegative("cost", data["cost"]),
        *(whole(data[name], name, PlanError, 0, 1 << 62) for name in ("expanded", "generated")),
        *(nonnegative(name, data[name]) for name in times),
    )


def _arrays(data: dict[str, Any], k: int, limbs: int) -> dict[str, Any]:
    """Arrays of a plan of k stances; no kernel looks up what is not checked here."""
    shapes = {
        "base_quaternions": (k, 4),
        "joint_positions": (k, limbs, 6),
        "w_m": (k, limbs),
        "w_b": (k,),
    }
    found = {name: numbers(data[name], shape, name, PlanError) for name, shape in shapes.items()}
    found["base_positions"] = numbers(
        data["base_positions"], (k, 3), "base_positions", PlanError, LONGEST
    )
    if (
        np.abs(np.linalg.norm(np.clip(found["base_quaternions"], -2.0, 2.0), axis=1) - 1.0).max()
        > 1e-6
    ):
        raise PlanError(
            f"base_quaternions is {shown(data['base_quaternions'])}; each must have length 1"
        )
    _check_angles(found["joint_positions"], "joint_positions")
    branches = numbers(data["branches"], (k, limbs), "branches", PlanError)
    if not np.isin(branches, range(BRANCHES)).all():
        kind = f"a whole number from 0 to {BRANCHES - 1}"
        raise PlanError(f"branches is {shown(data['branches'])}; each must be {kind}")
    return found | {"branches": branches.astype(np.int64)}


def _check_angles(angles: Array, where: str) -> None:
    if np.abs(angles).max(initial=0.0) > FARTHEST_TURN:
        largest = np.abs(angles).max()
        raise PlanError(
            f"{where} has an angle of {largest:g} rad; at most {FARTHEST_TURN:g} is possible"
        )


def _step(data: Any, where: str, limbs: int) -> Step:
    known = tuple(Step.__dataclass_fields__)
    if not isinstance(data, dict) or set(data) != set(known):
        raise PlanError(f"{where} is {shown(data)}; it must be an object with {', '.join(known)}")
    knots = entries(data["knots"], f"{where}.knots", PlanError)
    rows = numbers(knots, (len(knots), 7) if knots else (0,), f"{where}.knots", PlanError).reshape(
        -1, 7
    )
    u = rows[:, 0]
    if len(rows) and (len(rows) < 2 or u[0] != 0.0 or u[-1] != 1.0 or (np.diff(u) < 0.0).any()):
        raise PlanError(
            f"{where}.knots must be two or more, with base parameters that rise from 0 to 1, "
            f"not {shown(u)}"
        )
    _check_angles(rows[:, 1:], f"{where}.knots")
    x, y, z = numbers(data["pivot"], (3,), f"{where}.pivot", PlanError, LONGEST).tolist()
    return Step(
        limb=whole(data["limb"], f"{where}.limb", PlanError, 0, limbs - 1),
        from_point=text(data["from_point"], f"{where}.from_point", PlanError),
        to_point=text(data["to_point"], f"{where}.to_point", PlanError),
        path=choice(f"{where}.path", data["path"], (*PATH_KINDS, "unchecked")),
        pivot=(x, y, z),
        displacement=nonnegative(f"{where}.displacement", data["displacement"]),
        swing=choice(f"{where}.swing", data["swing"], SWING_KINDS),
        knots=tuple(tuple(row) for row in rows.tolist()),
    )


def _check_order(stances: tuple[tuple[str, ...], ...], steps: tuple[Step, ...]) -> None:
    """Each step must lead from its stance to the next."""
    for i, (before, step, after) in enumerate(zip(stances[:-1], steps, stances[1:], strict=True)):
        reached = tuple(
            step.to_point if limb == step.limb else point for limb, point in enumerate(before)
        )
        if before[step.limb] != step.from_point or reached != after:
            raise PlanError(f"steps[{i}] does not lead from stances[{i}] to the next")


def _settings(data: Any) -> Settings:
    known = tuple(Settings.__dataclass_fields__)
    if not isinstance(data, dict) or not set(data) <= set(known):
        raise PlanError(f"settings is {shown(data)}; it must be an object with {', '.join(known)}")
    return Settings(**data)


def _texts(data: Any, where: str, count: int | None = None) -> tuple[str, ...]:
    """Point ids, `count` of them if that is given."""
    ids = tuple(
        text(entry, where, PlanError) for entry in entries(data, where, PlanError, MOST_POINTS)
    )
    if count is not None and len(ids) != count:
        raise PlanError(f"{where} names {len(ids)} points; the robot has {count} limbs")
    return ids
