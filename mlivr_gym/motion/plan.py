"""Plans: what a search returns, complete enough to be carried out."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.errors import MlivrError, PlanError, choice, nonnegative, shown
from mlivr_gym.files import read_json, write_whole
from mlivr_gym.kinematics.base_path import PATH_KINDS
from mlivr_gym.motion.swings import SWING_KINDS
from mlivr_gym.robot.specification import FARTHEST_TURN, RobotSpec
from mlivr_gym.settings import GRAPH_RULES, Settings, check_rules
from mlivr_gym.values import LONGEST, MOST_POINTS, entries, numbers, text, whole
from mlivr_gym.world.boxes import Box, boxes_from
from mlivr_gym.world.grasp_map import GraspMap

Array = NDArray[np.float64]

FORMAT = 2
"""Version of the file format."""

COSTS = ("base", "steps", "weighted")
"""Names of the costs."""

BRANCHES = 8
"""Inverse-kinematics branches of a limb."""

MOST_STEPS = 10_000
"""Most steps of a plan that is read; a walk through the JEM and back takes about twenty."""


@dataclass(frozen=True)
class Step:
    """One regrasp and the base motion that goes with it.

    Attributes:
        limb: Limb that moves.
        from_point: Point it leaves.
        to_point: Point it takes hold of.
        path: `"straight"`, `"arc"`, or `"unchecked"` where steps were not checked.
        pivot: Centre of the arc: centroid of the held points [m].
        displacement: Base displacement [m].
        swing: Kind of the limb's way, one of `mlivr_gym.motion.swings.SWING_KINDS`.
        knots: Base parameter from 0 to 1 and the limb's six joint angles [rad] at each knot of its
            way, from above the point it leaves to above the point it takes hold of; in between both
            change linearly.
    """

    limb: int
    from_point: str
    to_point: str
    path: str
    pivot: tuple[float, float, float]
    displacement: float
    swing: str = "unchecked"
    knots: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True)
class Plan:
    """A sequence of K stances and everything that belongs to it.

    Attributes:
        stances: Point ids of each limb, K tuples of N.
        actions: Limb and point id of each step, K - 1 pairs.
        steps: Steps, K - 1.
        base_positions: Shape (K, 3) [m].
        base_quaternions: Shape (K, 4), w, x, y, z.
        joint_positions: Shape (K, N, 6) [rad]; continuous while a limb holds.
        branches: Branch of each limb, shape (K, N).
        w_m: Limb manipulability, shape (K, N).
        w_b: Base manipulability, shape (K,).
        goal: Goal position [m].
        goal_tolerance: Radius of the goal region [m].
        cost_name: Name of the cost.
        cost: Cost of the plan.
        regrasp_price: Metres charged for a regrasp, if the cost is `"weighted"`.
        method: Search method.
        heuristic: Heuristic.
        expanded: States expanded.
        generated: States generated.
        feasibility_time: Time spent on postures and stances for this query [s].
        search_time: Time spent on search and step checks [s].
        map_name: Name of the map.
        map_fingerprint: Hash of the map's points and boxes.
        obstacles: Boxes that stood in the way when the plan was made.
        occupied: Ids of points that were not to be grasped.
        robot: Description of the robot.
        settings: Thresholds and switches.
    """

    stances: tuple[tuple[str, ...], ...]
    actions: tuple[tuple[int, str], ...]
    steps: tuple[Step, ...]
    base_positions: Array
    base_quaternions: Array
    joint_positions: Array
    branches: NDArray[np.int64]
    w_m: Array
    w_b: Array
    goal: tuple[float, float, float]
    goal_tolerance: float
    cost_name: str
    cost: float
    regrasp_price: float | None
    method: str
    heuristic: str
    expanded: int
    generated: int
    feasibility_time: float
    search_time: float
    map_name: str
    map_fingerprint: str
    obstacles: tuple[Box, ...] = ()
    occupied: tuple[str, ...] = ()
    robot: RobotSpec = field(default_factory=RobotSpec)
    settings: Settings = field(default_factory=Settings)

    @property
    def base_translation(self) -> float:
        """Sum of the base displacements [m]."""
        return float(np.linalg.norm(np.diff(self.base_positions, axis=0), axis=1).sum())

    def configuration(self, k: int) -> tuple[Array, Array, Array]:
        """Base position [m], quaternion w, x, y, z, and joint angles (N, 6) [rad] in stance `k`."""
        return self.base_positions[k], self.base_quaternions[k], self.joint_positions[k]

    @property
    def w_m_min(self) -> float:
        """Least limb manipulability over all stances and limbs."""
        return float(self.w_m.min())

    @property
    def w_b_min(self) -> float:
        """Least base manipulability over all stances."""
        return float(self.w_b.min())

    def to_dict(self) -> dict[str, Any]:
        """The plan as plain data for JSON."""
        data: dict[str, Any] = {"format": FORMAT, "rules": GRAPH_RULES}
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            data[name] = value.tolist() if isinstance(value, np.ndarray) else value
        data["steps"] = [asdict(step) for step in self.steps]
        data["obstacles"] = [box.to_dict() for box in self.obstacles]
        data["robot"], data["settings"] = self.robot.to_dict(), asdict(self.settings)
        return data

    def save(self, path: str | Path) -> None:
        """Write the plan as JSON, whole or not at all.

        Raises:
            FileError: If the file cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=1) + "\n")

    @classmethod
    def from_dict(cls, data: Any, grasp_map: GraspMap | None = None) -> Plan:
        """Build a plan from plain data.

        Args:
            data: The parsed JSON.
            grasp_map: If given, the plan must have been made on this map.

        Raises:
            PlanError: If a field is missing or faulty, or the plan belongs to another map or to
                other rules of the stance graph.
        """
        if not isinstance(data, dict) or data.get("format") != FORMAT:
            given = data.get("format") if isinstance(data, dict) else type(data).__name__
            raise PlanError(f"not a plan of format {FORMAT}: found format {shown(given)}")
        check_rules("the plan", data.get("rules"), "plan it anew", PlanError)
        for name in cls.__dataclass_fields__:
            if name not in data:
                raise PlanError(f"the plan lacks field {name!r}")
        try:
            plan = cls(**_values(data))
        except MlivrError as error:
            raise PlanError(f"the plan has a faulty field: {error}") from None
        if grasp_map is not None:
            plan._check_map(grasp_map)
        return plan

    def _check_map(self, grasp_map: GraspMap) -> None:
        if self.map_fingerprint != grasp_map.fingerprint:
            raise PlanError(
                f"the plan was made on map {self.map_name!r} ({self.map_fingerprint}), not on {grasp_map.name!r} "
                f"({grasp_map.fingerprint})"
            )
        try:
            for point in (*(point for stance in self.stances for point in stance), *self.occupied):
                grasp_map.index(point)
        except MlivrError as error:
            raise PlanError(f"the plan has a faulty field: {error}") from None

    @classmethod
    def load(cls, path: str | Path, grasp_map: GraspMap | None = None) -> Plan:
        """Read a plan from a JSON file; see `from_dict`.

        Raises:
            PlanError: If the file cannot be read or does not hold a plan for this map.
        """
        data = read_json(path, "plan", PlanError)
        try:
            return cls.from_dict(data, grasp_map)
        except PlanError as error:
            raise PlanError(f"plan {str(path)!r}: {error}") from None


def _values(data: dict[str, Any]) -> dict[str, Any]:
    """The fields of a plan from plain data, each checked; errors name the field."""
    robot = RobotSpec.from_dict(data["robot"])
    k, limbs = len(entries(data["stances"], "stances", PlanError, MOST_STEPS)), robot.limbs
    stances = tuple(
        _texts(stance, f"stances[{i}]", limbs) for i, stance in enumerate(data["stances"])
    )
    steps = tuple(
        _step(step, f"steps[{i}]", limbs) for i, step in enumerate(_entries(data, "steps"))
    )
    actions = tuple(
        _action(pair, f"actions[{i}]", limbs) for i, pair in enumerate(_entries(data, "actions"))
    )
    if k == 0 or len(steps) != k - 1 or len(actions) != k - 1:
        raise PlanError(f"the plan has {k} stances, {len(steps)} steps and {len(actions)} actions")
    _check_order(stances, steps, actions)
    values: dict[str, Any] = {
        "robot": robot, "stances": stances, "steps": steps, "actions": actions,
        "settings": _settings(data["settings"]),
        "obstacles": boxes_from(data["obstacles"], "obstacle"),
        "occupied": _texts(data["occupied"], "occupied"),
        "cost_name": choice("cost_name", data["cost_name"], COSTS),
        "regrasp_price": data["regrasp_price"],
    }  # fmt: skip
    if values["regrasp_price"] is not None:
        values["regrasp_price"] = nonnegative("regrasp_price", values["regrasp_price"])
    values["goal"] = tuple(numbers(data["goal"], (3,), "goal", PlanError, LONGEST).tolist())
    for name in ("method", "heuristic", "map_name", "map_fingerprint"):
        values[name] = text(data[name], name, PlanError)
    for name in ("goal_tolerance", "cost", "feasibility_time", "search_time"):
        values[name] = nonnegative(name, data[name])
    for name in ("expanded", "generated"):
        values[name] = whole(data[name], name, PlanError, 0, 1 << 62)
    return values | _arrays(data, k, limbs)


def _arrays(data: dict[str, Any], k: int, limbs: int) -> dict[str, NDArray[Any]]:
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
            f"{where}.knots must be two or more, with base parameters that rise from 0 to 1, not {shown(u)}"
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


def _action(data: Any, where: str, limbs: int) -> tuple[int, str]:
    pair = entries(data, where, PlanError)
    if len(pair) != 2:
        raise PlanError(f"{where} is {shown(data)}; it must be a limb and a point")
    return whole(pair[0], where, PlanError, 0, limbs - 1), text(pair[1], where, PlanError)


def _check_order(
    stances: tuple[tuple[str, ...], ...],
    steps: tuple[Step, ...],
    actions: tuple[tuple[int, str], ...],
) -> None:
    """Each step must lead from its stance to the next, and be the action of its place."""
    for i, (before, step, after, action) in enumerate(
        zip(stances[:-1], steps, stances[1:], actions, strict=True)
    ):
        landed = tuple(
            step.to_point if limb == step.limb else point for limb, point in enumerate(before)
        )
        if (
            before[step.limb] != step.from_point
            or landed != after
            or action != (step.limb, step.to_point)
        ):
            raise PlanError(
                f"steps[{i}] and actions[{i}] do not lead from stances[{i}] to the next"
            )


def _settings(data: Any) -> Settings:
    known = tuple(Settings.__dataclass_fields__)
    if not isinstance(data, dict) or not set(data) <= set(known):
        raise PlanError(f"settings is {shown(data)}; it must be an object with {', '.join(known)}")
    return Settings(**data)


def _entries(data: dict[str, Any], name: str) -> list[Any]:
    return entries(data[name], name, PlanError, MOST_STEPS)


def _texts(data: Any, where: str, count: int | None = None) -> tuple[str, ...]:
    """Point ids, `count` of them if that is given."""
    ids = tuple(
        text(entry, where, PlanError) for entry in entries(data, where, PlanError, MOST_POINTS)
    )
    if count is not None and len(ids) != count:
        raise PlanError(f"{where} names {len(ids)} points; the robot has {count} limbs")
    return ids
