"""Plans: the results of a search, with everything that is needed to execute them."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import FileName, InstanceOf, Validators, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError, PlanError, shortened
from mlivr_gym.files import load, write_whole
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.plan_checks import check_motion, check_totals
from mlivr_gym.motion.plan_files import plan_data, read_parts
from mlivr_gym.motion.plan_parts import Motion, Query, Statistics, Step, World
from mlivr_gym.schema import Anything, OrNone
from mlivr_gym.values import EqualByData
from mlivr_gym.world.grasp_map import GraspMap

READ: Validators = {
    "path": FileName(),
    "data": Anything(),
    "grasp_map": OrNone(InstanceOf(GraspMap)),
}
"""Schema of the arguments from which a plan is read."""


@dataclass(frozen=True, repr=False, eq=False)
class Plan(EqualByData):
    """A sequence of K stances with the committed steps between them.

    Examples
    --------
    >>> from mlivr_gym import stance_graph
    >>> from mlivr_gym.planners import Planner
    >>> graph = stance_graph()
    >>> plan = Planner(graph).plan(("D2a:4", "D2b:4"), (6.0, 0.0, 0.42), cost="steps").unwrap()
    >>> len(plan.stances) == len(plan.steps) + 1
    True
    >>> Plan.from_dict(plan.to_dict(), graph.grasp_map).actions == plan.actions
    True
    """

    query: Query
    """The query that the plan answers."""
    world: World
    """The map, obstacles, robot and settings for which the plan was made."""
    motion: Motion
    """Stances, steps and configurations."""
    statistics: Statistics
    """Cost of the plan, and the effort of the search."""

    def __repr__(self) -> str:
        """Return the robot, the map, both end stances, the number of steps and the translation."""
        start, end = (" ".join(stance) for stance in (self.stances[0], self.stances[-1]))
        return (
            f"<Plan of {self.world.robot.name!r} on {self.world.map_name!r}: {start} to {end}, "
            f"{len(self.steps)} steps, {self.base_translation:.3f} m>"
        )

    @property
    def stances(self) -> tuple[tuple[str, ...], ...]:
        """Ids of the points that the limbs hold in each stance, K tuples of N."""
        return self.motion.stances

    @property
    def steps(self) -> tuple[Step, ...]:
        """The K - 1 committed steps."""
        return self.motion.steps

    @property
    def actions(self) -> tuple[tuple[int, str], ...]:
        """Limb that moves and id of the point that it grasps, for each of the K - 1 steps."""
        return tuple((step.limb, step.to_point) for step in self.steps)

    @property
    def footholds(self) -> tuple[tuple[str, ...], ...]:
        """Ids of the points that each limb holds, in their order along the plan, N tuples."""
        starts = self.stances[0]
        return tuple(
            (start, *(step.to_point for step in self.steps if step.limb == limb))
            for limb, start in enumerate(starts)
        )

    @property
    def cost(self) -> float:
        """Cost of the plan, in the unit of the query's cost ([m] or number of steps)."""
        return self.statistics.cost

    @property
    def base_translation(self) -> float:
        """Sum of the base displacements over all steps [m]."""
        return float(np.linalg.norm(np.diff(self.motion.base_positions, axis=0), axis=1).sum())

    @property
    def w_m_min(self) -> float:
        """Minimum limb manipulability over all stances and limbs."""
        return float(self.motion.w_m.min())

    @property
    def w_b_min(self) -> float:
        """Minimum base manipulability over all stances."""
        return float(self.motion.w_b.min())

    @checked()
    def configuration(self, k: int) -> tuple[Array, Array, Array]:
        """Return the configuration of the robot in stance `k`.

        It is the base position in the world, shape (3,) [m]; base orientation w, x, y, z, shape
        (4,); and joint angles, shape (N, 6) [rad].
        """
        motion = self.motion
        if not -len(self.stances) <= k < len(self.stances):
            raise PlanError(f"k is {k}; the plan has {len(self.stances)} stances, from 0")
        return motion.base_positions[k], motion.base_quaternions[k], motion.joint_positions[k]

    @checked()
    def joint_path(self, index: int) -> JointPath:
        """Return the joint path of a step, by its index from 0.

        Raises a `PlanError` if the plan has no such step, or the step has no joint path.
        """
        return self.motion.joint_path(self.world.robot, index)

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain data for JSON."""
        return plan_data(self.query, self.world, self.motion, self.statistics)

    def save(self, path: str | Path) -> None:
        """Write the plan as JSON; the file is replaced as a whole or not at all.

        Lists of numbers stand in one line. Raises a `FileError` if the file cannot be written.
        """
        text = json.dumps(self.to_dict(), indent=1)
        text = re.sub(r"\[\s+([-.\de,\s]+)\]", lambda m: f"[{' '.join(m[1].split())}]", text)
        write_whole(path, text + "\n")

    @classmethod
    @checked(READ, PlanError)
    def from_dict(cls, data: Any, grasp_map: GraspMap | None = None) -> Plan:
        """Build a plan from plain data, and check it by recomputing what follows from other fields.

        If the map is given, on which the plan must have been made, the whole motion is recomputed
        and compared; if not, only displacements, cost, goal and checksum are. Raises a `PlanError`
        if a field is missing or invalid, if the plan belongs to another map or to another version
        of the graph rules, or if a value differs from the recomputed one.
        """
        plan = cls(*read_parts(data))
        if grasp_map is not None:
            plan.check_map(grasp_map)
            check_motion(plan.query, plan.world, plan.motion, grasp_map)
        check_totals(plan.query, plan.motion, plan.statistics)
        given, expected = data.get("checksum"), plan.to_dict()["checksum"]
        if given is not None and given != expected:
            raise PlanError(
                f"checksum is {shortened(given)}, but the other fields give {expected!r}: a "
                "field that cannot be recomputed from the others was altered"
            )
        return plan

    @checked()
    def check_map(self, grasp_map: GraspMap) -> None:
        """Check that the plan was made on the given map.

        Raises a `PlanError` if the map has another fingerprint, or lacks a point of the plan.
        """
        world = self.world
        if world.map_fingerprint != grasp_map.fingerprint:
            raise PlanError(
                f"the plan was made on map {world.map_name!r} ({world.map_fingerprint}), not on "
                f"{grasp_map.name!r} ({grasp_map.fingerprint})"
            )
        try:
            for point in (*(point for stance in self.stances for point in stance), *world.occupied):
                grasp_map.index(point)
        except MlivrError as error:
            raise PlanError(f"the plan has a faulty field: {error}") from None

    @classmethod
    @checked(READ, PlanError)
    def load(cls, path: str | Path, grasp_map: GraspMap | None = None) -> Plan:
        """Read a plan from a JSON file, with the checks of `from_dict`.

        The map is that on which the plan must have been made. Raises a `PlanError` if the file
        cannot be read, or does not hold a valid plan for this map.
        """
        return load(path, "plan", PlanError, lambda data: cls.from_dict(data, grasp_map))
