"""Plans: what a search returns, complete enough to be carried out."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.errors import PlanError
from mlivr_gym.files import write_whole
from mlivr_gym.grasp_map import GraspMap
from mlivr_gym.robot import RobotSpec
from mlivr_gym.settings import GRAPH_RULES, Settings, check_rules
from mlivr_gym.shapes import Box, boxes_from

Array = NDArray[np.float64]

FORMAT = 2
"""Version of the file format."""


@dataclass(frozen=True)
class Step:
    """One regrasp and the base motion that goes with it.

    Attributes:
        limb: Limb that moves.
        departs: Point it leaves.
        lands: Point it takes hold of.
        path: `"straight"`, `"arc"`, or `"unchecked"` where steps were not checked.
        pivot: Centre of the arc: centroid of the held points [m].
        displacement: Base displacement [m].
        swing: Kind of the limb's way, one of `mlivr_gym.swing.SWING_KINDS`.
        knots: Base parameter from 0 to 1 and the limb's six joint angles [rad] at each knot of its way, from above the
            point it leaves to above the point it takes hold of; in between both change linearly.
    """

    limb: int
    departs: str
    lands: str
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
            raise PlanError(f"not a plan of format {FORMAT}: found format {given!r}")
        check_rules("the plan", data.get("rules"), "plan it anew", PlanError)
        try:
            values = {name: data[name] for name in cls.__dataclass_fields__}
            for name in ("base_positions", "base_quaternions", "joint_positions", "w_m", "w_b"):
                values[name] = np.array(values[name], dtype=np.float64)
            values["branches"] = np.array(values["branches"], dtype=np.int64)
            values["stances"] = tuple(tuple(map(str, stance)) for stance in values["stances"])
            values["actions"] = tuple((int(limb), str(point)) for limb, point in values["actions"])
            values["steps"] = tuple(_step(step) for step in values["steps"])
            values["obstacles"] = boxes_from(values["obstacles"], "obstacle")
            values["occupied"] = tuple(map(str, values["occupied"]))
            values["goal"] = tuple(float(v) for v in values["goal"])
            values["robot"] = RobotSpec.from_dict(values["robot"])
            values["settings"] = Settings(**values["settings"])
        except KeyError as error:
            raise PlanError(f"the plan lacks field {error.args[0]!r}") from None
        except (TypeError, ValueError) as error:
            raise PlanError(f"the plan has a faulty field: {error}") from None
        plan = cls(**values)
        plan._check_shapes()
        if grasp_map is not None and plan.map_fingerprint != grasp_map.fingerprint:
            raise PlanError(
                f"the plan was made on map {plan.map_name!r} ({plan.map_fingerprint}), not on {grasp_map.name!r} "
                f"({grasp_map.fingerprint})"
            )
        return plan

    def _check_shapes(self) -> None:
        k, limbs = len(self.stances), self.robot.limbs
        shapes = {
            "base_positions": (k, 3), "base_quaternions": (k, 4), "joint_positions": (k, limbs, 6),
            "branches": (k, limbs), "w_m": (k, limbs), "w_b": (k,),
        }  # fmt: skip
        for name, shape in shapes.items():
            found = getattr(self, name).shape
            if found != shape:
                raise PlanError(f"the plan's {name} has shape {found}; {k} stances need {shape}")
        if k == 0 or len(self.steps) != k - 1 or len(self.actions) != k - 1:
            raise PlanError(f"the plan has {k} stances, {len(self.steps)} steps and {len(self.actions)} actions")

    @classmethod
    def load(cls, path: str | Path, grasp_map: GraspMap | None = None) -> Plan:
        """Read a plan from a JSON file; see `from_dict`.

        Raises:
            PlanError: If the file cannot be read or does not hold a plan for this map.
        """
        try:
            data = json.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
            raise PlanError(f"cannot read plan {str(path)!r}: {error}") from None
        return cls.from_dict(data, grasp_map)


def _step(data: dict[str, Any]) -> Step:
    knots = tuple(tuple(float(value) for value in knot) for knot in data["knots"])
    return Step(**{**data, "pivot": tuple(data["pivot"]), "knots": knots})
