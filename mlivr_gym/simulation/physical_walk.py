"""A walk through the stance graph that is carried out in MuJoCo, one regrasp at a time.

The graph keeps sets of inverse-kinematics branches; a robot is on one of them, with one winding of
every joint. A `PhysicalWalk` commits to a branch when a limb lands and follows the joint angles
from then on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.base_path import LIMIT_TOLERANCE
from mlivr_gym.motion.regrasp import Regrasp, RegraspPath, planned_regrasp
from mlivr_gym.motion.swings import Hold, SwingFinder, direct_line
from mlivr_gym.motion.trajectory import Durations, trajectory
from mlivr_gym.postures.given_pose import given_joints
from mlivr_gym.postures.solver import Postures
from mlivr_gym.simulation.dynamics import Physics, check_masses
from mlivr_gym.simulation.recording import Failure
from mlivr_gym.simulation.simulator import Carried, Simulation
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import State, Successors, join

Array = NDArray[np.float64]

LOOKS = 33
"""Places on a base path at which the joint limits of a limb that holds are looked at."""


class PhysicalWalk:
    """Carries out steps of a stance graph.

    Attributes:
        graph: The stance graph.
        durations: How long the parts of a step take.
        state: The present state, one branch a limb.
        joints: Joint angles of the stance, shape (N, 6) [rad].
        simulation: The simulation; it is made by `start`.
    """

    simulation: Simulation
    state: State
    joints: Array

    def __init__(
        self, graph: PairGraph | LazyGraph, durations: Durations, physics: Physics
    ) -> None:
        """Prepare walks; `start` begins one.

        Raises:
            RobotError: If the robot's masses are not known, see `dynamics.check_masses`.
        """
        check_masses(graph.robot, physics)
        self.graph, self.durations, self.physics = graph, durations, physics
        self._version = -1
        self._plan: Any = None
        self._done = 0

    def start(self, state: State, plan: Any = None, joints: Any = None) -> State:
        """Take hold of a stance at rest; returns the state with one branch a limb.

        Args:
            state: Where to start.
            plan: A plan from this stance; as long as it is followed, its branches, joint angles and
                swings are used.
            joints: Joint angles at the start, shape (N, 6) [rad], on the branches of `state`, if
                they are given.

        Raises:
            PlanError: If the plan has no step or does not fit the graph.
        """
        graph = self.graph
        if self._version != graph.version:
            self.simulation = Simulation(
                graph.grasp_map, graph.robot, self.physics, graph.obstacles
            )
            self._version = graph.version
        self._plan, self._done = plan, 0
        if plan is not None:
            self.joints = planned_regrasp(graph, plan, 0).joints.copy()
            self.state = self._on_branches(state, plan.branches[0])
        else:
            for limb in range(graph.limbs):
                state = self._committed(state, limb)[0]
            self.state = state
            self.joints = graph.configuration(self.state)[2]
            if joints is not None:
                turns = np.rint((given_joints(graph.robot, joints) - self.joints) / (2.0 * np.pi))
                self.joints += 2.0 * np.pi * turns
        position, quaternion, _ = graph.configuration(self.state)
        self.simulation.reset(position, quaternion, self.joints, self.state.stance)
        return self.state

    @property
    def configuration(self) -> tuple[Array, Array, Array]:
        """Base position [m], base quaternion and joint angles (N, 6) [rad] in the simulation."""
        return self.simulation.configuration

    def possible(self, steps: Successors) -> Successors:
        """Those of the steps from the present state in which every limb that holds stays inside its joint limits."""
        limits = self.graph.robot.limb.limits
        keep = np.zeros(len(steps.limb), dtype=np.bool_)
        for k in range(len(steps.limb)):
            path = self._path(int(steps.limb[k]), int(steps.point[k]))
            try:
                held = RegraspPath(self.graph, path).supports(np.linspace(0.0, 1.0, LOOKS))
            except PlanError:
                continue
            beyond = np.fmax(limits[:, 0] - held, held - limits[:, 1])
            if np.nanmax(beyond) <= LIMIT_TOLERANCE:
                keep[k] = True
        return Successors(
            steps.limb[keep], steps.point[keep], steps.position[keep], steps.masks[keep]
        )

    def step(
        self, limb: int, point: int, masks: tuple[int, ...]
    ) -> tuple[State, Carried | Failure]:
        """Carry out one step.

        Args:
            limb: The limb that moves.
            point: Point index it moves to.
            masks: Branches left to all limbs after the step.

        Returns:
            The state after the step, that before it if it failed, and what came of it; a `Failure`
            of its own if no way was found.
        """
        found = self._planned(limb, point) or self._found(limb, point, masks)
        if found is None:
            return self.state, self._no_way(
                limb, point, "no swing inside the joint limits was found"
            )
        step, after = found
        try:
            way = trajectory(RegraspPath(self.graph, step), self.durations, self.physics.timestep)
        except PlanError as error:
            return self.state, self._no_way(limb, point, str(error))
        carried = self.simulation.carry_out(way)
        if carried.failure is None:
            self.state, self.joints = after, way.joint_positions[-1]
        return self.state, carried

    def _no_way(self, limb: int, point: int, why: str) -> Failure:
        target = self.graph.grasp_map.ids[point]
        return Failure(
            "no way",
            self.simulation.time,
            0,
            "departure",
            limb,
            f"limb {limb} to {target!r}: {why}",
            {},
        )

    def _planned(self, limb: int, point: int) -> tuple[Regrasp, State] | None:
        """The next step of the plan, if this is it."""
        plan = self._plan
        if plan is None or self._done >= len(plan.steps):
            return None
        step = planned_regrasp(self.graph, plan, self._done)
        if (step.limb, step.to_point) != (limb, point):
            self._plan = None
            return None
        self._done += 1
        after = self._after(limb, point)
        joints = self.joints.copy()
        joints[limb] = step.landing
        landed = self._on_branches(State(after, ()), plan.branches[self._done], joints)
        masks = tuple(
            landed.masks[i] if i == limb else self.state.masks[i] for i in range(self.graph.limbs)
        )
        return step, State(after, masks)

    def _found(self, limb: int, point: int, masks: tuple[int, ...]) -> tuple[Regrasp, State] | None:
        """A swing, and the state it leads to: on the branch that keeps most steps open of those that a swing leads to."""
        graph, after = self.graph, self._after(limb, point)
        way = self._path(limb, point)
        postures = self._postures(after)
        holds = [Hold(i, p, _branch(self.state.masks[i])) for i, p in enumerate(after) if i != limb]
        path = (
            postures.position[0], postures.rotation[0], postures.position[1], postures.rotation[1],
            way.kind, way.pivot,
        )  # fmt: skip
        known = graph.way(self.state.stance, after, limb, postures, self.state.masks)
        line = None
        if known.pair >= 0:
            line = direct_line(graph, limb, (self.state.stance[limb], point), postures, known.pair)
        for landed in self._committed(State(after, masks), limb):
            landing = graph.configuration(landed)[2][limb]
            branches = (*way.branches[:-1], _branch(landed.masks[limb]))
            step = replace(way, branches=branches, landing=landing, knots=np.zeros((0, 7)))
            if not graph.settings.collisions:
                return step, landed
            rise = np.array([0.0, 1.0])
            ways = RegraspPath(graph, step)
            start, down = ways.departure(rise)[1], ways.approach(rise)
            limits = graph.robot.limb.limits
            fewest = np.ceil((limits[:, 0] - LIMIT_TOLERANCE - down.min(axis=0)) / (2.0 * np.pi))
            most = np.floor((limits[:, 1] + LIMIT_TOLERANCE - down.max(axis=0)) / (2.0 * np.pi))
            swing = SwingFinder(graph, limb, path, holds).find(
                start, down[0], (fewest, most), known.fold, line
            )
            if swing is not None:
                turned = 2.0 * np.pi * np.rint((swing.knots[-1, 1:] - down[0]) / (2.0 * np.pi))
                return replace(step, landing=landing + turned, knots=swing.knots), landed
        return None

    def _after(self, limb: int, point: int) -> tuple[int, ...]:
        return (*self.state.stance[:limb], point, *self.state.stance[limb + 1 :])

    def _postures(self, after: tuple[int, ...]) -> Postures:
        return join(self.graph.posture_of(self.state), self.graph.posture(after))

    def _path(self, limb: int, point: int) -> Regrasp:
        """The step as far as the limbs that hold are concerned."""
        graph, after = self.graph, self._after(limb, point)
        postures = self._postures(after)
        kind = graph.way(self.state.stance, after, limb, postures, self.state.masks).kind
        held = [p for i, p in enumerate(after) if i != limb]
        branches = [_branch(mask) for mask in self.state.masks]
        return Regrasp(
            limb, self.state.stance, point, postures.position, postures.rotation, kind,
            graph.grasp_map.positions[held].mean(axis=0), (*branches, branches[limb]), self.joints,
            self.joints[limb],
            np.stack([np.append(0.0, self.joints[limb]), np.append(1.0, self.joints[limb])]),
        )  # fmt: skip

    def _committed(self, state: State, limb: int) -> list[State]:
        """The state with a limb on each one of its branches, those that keep most steps open first, in a fixed order."""
        options = []
        for bit in range(16):
            if state.masks[limb] >> bit & 1:
                masks = tuple(1 << bit if i == limb else mask for i, mask in enumerate(state.masks))
                options.append(state._replace(masks=masks))
        return sorted(options, key=lambda option: -len(self.graph.successors(option).limb))

    def _on_branches(self, state: State, branches: Any, joints: Array | None = None) -> State:
        """The state of limbs on given branches; their joint angles tell the half turn of the tool."""
        joints = self.joints if joints is None else joints
        plain = state._replace(masks=tuple(1 << int(branch) for branch in branches))
        unturned = self.graph.configuration(plain)[2]
        turned = np.cos(joints[:, 5] - unturned[:, 5]) < 0.0
        masks = tuple(
            int(mask) << 8 * int(flip) for mask, flip in zip(plain.masks, turned, strict=True)
        )
        return state._replace(masks=masks)


def _branch(mask: int) -> int:
    """Branch of a mask with one bit."""
    return (mask.bit_length() - 1) & 7
