"""Plans: what a search returns, complete enough to be executed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import FileName, Kinds, Of, checked
from mlivr_gym.arrays import Array
from mlivr_gym.errors import MlivrError, PlanError, shortened
from mlivr_gym.files import load, write_whole
from mlivr_gym.motion.plan_checks import check_motion, check_totals
from mlivr_gym.motion.plan_files import parts_of, plan_data
from mlivr_gym.motion.plan_parts import Motion, Query, Statistics, Step, World
from mlivr_gym.schema import Anything, Maybe
from mlivr_gym.world.grasp_map import GraspMap

READ: Kinds = {"path": FileName(), "data": Anything(), "grasp_map": Maybe(Of(GraspMap))}
"""Kinds of what a plan is read from."""


@dataclass(frozen=True, repr=False)
class Plan:
    """A sequence of K stances and everything that belongs to it.

    Attributes
    ----------
    query
        What was asked for.
    world
        Where the plan was made, and for which robot.
    motion
        Stances, steps and configurations.
    statistics
        What the search expected and spent.
    """

    query: Query
    world: World
    motion: Motion
    statistics: Statistics

    def __repr__(self) -> str:
        """Ends, steps and translation, in one line."""
        start, end = (" ".join(stance) for stance in (self.stances[0], self.stances[-1]))
        return (
            f"<Plan of {self.world.robot.name!r} on {self.world.map_name!r}: {start} to {end}, "
            f"{len(self.steps)} steps, {self.base_translation:.3f} m>"
        )

    @property
    def stances(self) -> tuple[tuple[str, ...], ...]:
        """Point ids of each limb, K tuples of N."""
        return self.motion.stances

    @property
    def steps(self) -> tuple[Step, ...]:
        """The committed steps, K - 1."""
        return self.motion.steps

    @property
    def actions(self) -> tuple[tuple[int, str], ...]:
        """Limb and point id of each step, K - 1 pairs."""
        return tuple((step.limb, step.to_point) for step in self.steps)

    @property
    def footholds(self) -> tuple[tuple[str, ...], ...]:
        """The points that each limb holds one after the other, N tuples of ids."""
        starts = self.stances[0]
        return tuple(
            (start, *(step.to_point for step in self.steps if step.limb == limb))
            for limb, start in enumerate(starts)
        )

    @property
    def cost(self) -> float:
        """Cost of the plan."""
        return self.statistics.cost

    @property
    def base_translation(self) -> float:
        """Sum of the base displacements [m]."""
        return float(np.linalg.norm(np.diff(self.motion.base_positions, axis=0), axis=1).sum())

    @property
    def w_m_min(self) -> float:
        """Least limb manipulability over all stances and limbs."""
        return float(self.motion.w_m.min())

    @property
    def w_b_min(self) -> float:
        """Least base manipulability over all stances."""
        return float(self.motion.w_b.min())

    def configuration(self, k: int) -> tuple[Array, Array, Array]:
        """Base position [m], quaternion w, x, y, z, and joint angles (N, 6) [rad] in stance `k`."""
        motion = self.motion
        return motion.base_positions[k], motion.base_quaternions[k], motion.joint_positions[k]

    def to_dict(self) -> dict[str, Any]:
        """The plan as plain data for JSON."""
        return plan_data(self.query, self.world, self.motion, self.statistics)

    def save(self, path: str | Path) -> None:
        """Write the plan as JSON, whole or not at all.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=1) + "\n")

    @classmethod
    @checked(READ, PlanError)
    def from_dict(cls, data: Any, grasp_map: GraspMap | None = None) -> Plan:
        """Build a plan from plain data; what can be worked out again has to be what it tells.

        Parameters
        ----------
        data
            The parsed JSON.
        grasp_map
            If given, the plan must have been made on this map, and its whole motion is
            worked out again; else only what follows without the map is.

        Raises
        ------
        PlanError
            If a field is missing or faulty, the plan belongs to another map or to other
            rules of the stance graph, or a value is not the one that follows from the others.
        """
        plan = cls(*parts_of(data))
        if grasp_map is not None:
            plan.check_map(grasp_map)
            check_motion(plan.query, plan.world, plan.motion, grasp_map)
        check_totals(plan.query, plan.motion, plan.statistics)
        given, expected = data.get("checksum"), plan.to_dict()["checksum"]
        if given is not None and given != expected:
            raise PlanError(
                f"checksum is {shortened(given)}; that of the other fields is {expected!r}: a field "
                "that does not follow from others was altered"
            )
        return plan

    def check_map(self, grasp_map: GraspMap) -> None:
        """Refuse a map that the plan was not made on.

        Raises
        ------
        PlanError
            If it is another one.
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
        """Read a plan from a JSON file; see `from_dict`.

        Raises
        ------
        PlanError
            If the file cannot be read or does not hold a plan for this map.
        """
        return load(path, "plan", PlanError, lambda data: cls.from_dict(data, grasp_map))
