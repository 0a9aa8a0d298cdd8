"""Execution of single steps in MuJoCo, each chosen when the one before has ended.

Environments with dynamics and the closed loop choose the next step when they see the result of the
last one; a whole plan is executed by `execution.execute`.

The states of the stance graph hold sets of inverse-kinematics branches; a robot is on one of them.
A `StepExecutor` commits to a branch when a limb grasps. Every step that leaves its state has a
swing by construction; should none be found, or no time scaling within the limits, `step` reports
the failure `"no swing"`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.compiled.bit_sets import bits_of
from mlivr_gym.errors import PlanError, TimingError
from mlivr_gym.motion.commitment import commit
from mlivr_gym.motion.joint_path import JointPath
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.step_ends import StepEnds
from mlivr_gym.motion.trajectory import Trajectory, trajectory
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.recording import Failure, SimulatedInterval
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.simulator import PathWatch, Simulation
from mlivr_gym.simulation.timing import timed_path
from mlivr_gym.stances.checked_steps import join
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State, moving_limb
from mlivr_gym.world.boxes import Box

MEASURES = (
    "capture_distance", "capture_angle", "peak_torque", "torque_rms", "peak_grasp_force",
    "peak_grasp_torque", "base_error", "step_time", "simulated_time",
)  # fmt: skip
"""Keys of `StepExecutor.measures` in addition to `failure`."""


class PreparedStep(NamedTuple):
    """A step with swing and trajectory, which can be executed where it begins."""

    trajectory: Trajectory
    """The trajectory."""
    after: State
    """The state after it, with one branch for each limb."""


class StepExecutor:
    """Executor of single steps of a stance graph in MuJoCo.

    `state` is the present state, with one branch for each limb, and `joints` its joint angles,
    shape (N, 6) [rad]. `steps_done` counts the steps since `start` that ended with a grasp: the
    index of the next step in its captures, failures and recordings. `measures` are those of the
    last step: `failure`, None or a dictionary, and the keys of `MEASURES`.
    """

    simulation: Simulation
    state: State
    joints: Array
    steps_done: int
    measures: dict[str, Any]
    _executed: Trajectory

    def __init__(
        self, graph: StanceGraph, setup: Setup, obstacles: Sequence[Box] | None = None
    ) -> None:
        """Prepare the execution by a setup; `start` puts the robot into its first stance.

        Simulated beside the boxes of the map are obstacles, by default the graph's. Raises a
        `RobotError` if the robot's masses are not known, see `RobotSpec.dynamics_of`.
        """
        self.graph, self.setup, self._obstacles = graph, setup, obstacles
        self._simulated: tuple[int, int] | None = None
        _ = graph.robot.torque_limits
        self._plan: Plan | None = None
        self._next = 0

    def start(self, state: State, plan: Plan | None = None, seed: int = 0) -> State:
        """Put the robot at rest into a stance; return the state with one branch for each limb.

        As long as the steps are those of a plan from this stance, its branches, joint angles and
        swings are used. The seed is that of the disturbance. Raises a `PlanError` if the plan has
        no step or does not fit the graph.
        """
        graph = self.graph
        if self._simulated != (graph.version, seed):
            boxes = graph.obstacles if self._obstacles is None else self._obstacles
            self.simulation = self.setup.simulation(graph.grasp_map, graph.robot, boxes, seed)
            self._simulated = graph.version, seed
        self._plan, self._next, self.steps_done = plan, 0, 0
        if plan is not None:
            self.joints = plan.joint_path(0).knots[0]
            self.state = self._on_branches(state, plan.motion.branches[0], self.joints)
        else:
            for limb in range(graph.limbs):
                state = self._options(state, limb)[0]
            self.state = state
            self.joints = graph.configuration(self.state)[2]
        position, quaternion, _ = graph.configuration(self.state)
        self.simulation.reset(position, quaternion, self.joints, self.state.stance)
        self.measures = {"failure": None} | dict.fromkeys(MEASURES, 0.0)
        return self.state

    def draw(self, stream: Any) -> int:
        """Draw a seed of the disturbance from a random stream; return 0 if the setup has none."""
        if self.setup.disturbances == DisturbanceRanges():
            return 0
        return 1 + int(stream.integers(2**31))

    @property
    def configuration(self) -> tuple[Array, Array, Array]:
        """Simulated base position [m], quaternion w, x, y, z and joint angles (N, 6) [rad]."""
        return self.simulation.configuration

    def step(
        self, limb: int, point: int, branch_sets: tuple[int, ...]
    ) -> tuple[State, SimulatedInterval | Failure]:
        """Move a limb to a point, given by its index, and to branches of all limbs after the step.

        Returned are the state after the step, or before it if the step failed, and the executed
        step, or a `Failure` alone if the step has no swing or no trajectory.
        """
        prepared = self.prepared(limb, point, branch_sets)
        if isinstance(prepared, Failure):
            measures = dict.fromkeys(MEASURES, 0.0) | {"simulated_time": prepared.time}
            self.measures = {"failure": prepared.to_dict()} | measures
            return self.state, prepared
        return self.take(prepared)

    def prepared(
        self, limb: int, point: int, branch_sets: tuple[int, ...]
    ) -> PreparedStep | Failure:
        """Return a step from the present state that can be taken, or the failure `"no swing"`."""
        after = self.state.stance_after(limb, point)
        result = self._planned(after) or self._committed(State(after, branch_sets))
        if result is None:
            return self._not_begun(limb, point, "no swing was found")
        path, reached = result
        graph, period = self.graph, self.setup.physics.timestep
        stances = graph.ids(self.state.stance), graph.ids(after)
        try:
            timed = timed_path(path, self.setup.timing)
            return PreparedStep(trajectory(graph.grasp_map, stances, timed, period), reached)
        except (PlanError, TimingError) as error:
            return self._not_begun(limb, point, str(error))

    def take(
        self, prepared: PreparedStep, watch: PathWatch | None = None
    ) -> tuple[State, SimulatedInterval]:
        """Take a step that was prepared for the present state; return the same as `step`.

        `watch` looks ahead during the step.
        """
        begin, self._executed = self.simulation.time, prepared.trajectory
        executed = self.simulation.execute(prepared.trajectory, self.steps_done, watch)
        if executed.failure is None:
            self.steps_done += 1
            self.state, self.joints = prepared.after, prepared.trajectory.joint_positions[-1]
        self.measures = _measures(executed, begin, self.simulation.time)
        return self.state, executed

    def follow(self, plan: Plan | None) -> None:
        """Follow a plan from the present state as long as the steps are its own.

        Its branches, joint angles and swings are used, unless it starts with other joint angles.
        Without a plan each step is committed to a branch and a swing of its own.
        """
        if plan is not None:
            joints = plan.joint_path(0).knots[0]
            plan = plan if np.allclose(joints, self.joints, atol=1e-6) else None
        self._plan, self._next = plan, 0

    def retreat(self) -> SimulatedInterval:
        """Go back to the present state from a step at whose end nothing was grasped."""
        self._plan = None
        return self.simulation.retreat(self._executed, self.steps_done)

    def _not_begun(self, limb: int, point: int, why: str) -> Failure:
        """Return the failure of a step that could not start."""
        message = f"limb {limb} to {self.graph.grasp_map.ids[point]!r}: {why}"
        time, step = self.simulation.time, self.steps_done
        return Failure("no swing", time, step, "departure", limb, message, {})

    def _planned(self, after: tuple[int, ...]) -> tuple[JointPath, State] | None:
        """Return the next step of the plan and its state, if it leads to the stance `after`."""
        plan = self._plan
        if plan is None or self._next >= len(plan.steps):
            return None
        path = plan.joint_path(self._next)
        if self.graph.indices(plan.stances[self._next + 1]) != after:
            self._plan = None
            return None
        self._next += 1
        joints, limb = self.joints.copy(), path.limb
        joints[limb] = path.knots[-1, limb]
        there = self._on_branches(State(after, ()), plan.motion.branches[self._next], joints)
        branch_sets = self.state.branch_sets
        return path, _with_branch_set(State(after, branch_sets), limb, there.branch_sets[limb])

    def _committed(self, reached: State) -> tuple[JointPath, State] | None:
        """Return a step to a stance, and the state that it reaches; None if no swing exists.

        Of the branches with a swing the limb takes the one with most successors.
        """
        graph, state, after = self.graph, self.state, reached.stance
        postures = join(graph.posture_of(state), graph.posture(after))
        limb = moving_limb(state.stance, after)
        branches = [bits_of(branch_set)[0] & 7 for branch_set in state.branch_sets]
        for option in self._options(reached, limb):
            ends = StepEnds(
                limb, state.stance, after[limb], postures.base_position, postures.base_rotation,
                (*branches, bits_of(option.branch_sets[limb])[0] & 7),
                np.stack([self.joints, graph.configuration(option)[2]]),
            )  # fmt: skip
            committed = commit(graph, ends)
            if committed is not None and committed.path is not None:
                return committed.path, option
        return None

    def _options(self, state: State, limb: int) -> list[State]:
        """Return the state with a limb on each of its branches, most successors first."""
        branches = bits_of(state.branch_sets[limb])
        options = [_with_branch_set(state, limb, 1 << branch) for branch in branches]
        return sorted(options, key=lambda option: -len(self.graph.successors(option).limb))

    def _on_branches(
        self, state: State, branches: Sequence[int] | IntArray, joints: Array
    ) -> State:
        """Return the state with limbs on given branches; the flips follow from the joint angles."""
        plain = state._replace(branch_sets=tuple(1 << int(branch) for branch in branches))
        unturned = self.graph.configuration(plain)[2]
        flips = (np.cos(joints[:, 5] - unturned[:, 5]) < 0.0).tolist()
        turned = zip(plain.branch_sets, flips, strict=True)
        return state._replace(branch_sets=tuple(one << 8 * flip for one, flip in turned))


def _with_branch_set(state: State, limb: int, branch_set: int) -> State:
    """Return the state with another branch set of a limb."""
    before = state.branch_sets
    return state._replace(branch_sets=(*before[:limb], branch_set, *before[limb + 1 :]))


def _measures(executed: SimulatedInterval, begin: float, time: float) -> dict[str, Any]:
    """Return the measurements of a step that lasted from `begin` to `time` [s]."""
    peaks, failure = executed.peaks, executed.failure
    return {
        "failure": None if failure is None else failure.to_dict(),
        "capture_distance": max((one.distance for one in executed.captures), default=0.0),
        "capture_angle": max((one.angle for one in executed.captures), default=0.0),
        "peak_torque": float(peaks.joint_torque.max()),
        "torque_rms": peaks.torque_rms,
        "peak_grasp_force": float(peaks.grasp_force.max()),
        "peak_grasp_torque": float(peaks.grasp_torque.max()),
        "base_error": peaks.base_error,
        "step_time": time - begin,
        "simulated_time": time,
    }
