"""The Gymnasium environment `MLIVR-JEM-v0`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.envs.actions import action_number
from mlivr_gym.envs.grasp_failure import failure_probabilities
from mlivr_gym.envs.observations import (
    Observation,
    PlaceObservation,
    observation,
    observation_space,
    place_observation,
)
from mlivr_gym.envs.plain_spec import PlainSpec
from mlivr_gym.envs.rewards import Reward, StepOutcome, TaskReward, reward_of
from mlivr_gym.envs.tasks import TaskGenerator, generator_of
from mlivr_gym.errors import SettingError, StanceError, choice, nonnegative
from mlivr_gym.motion.trajectory import Durations
from mlivr_gym.robot.specification import RobotSpec, robot_spec
from mlivr_gym.settings import CLEARANCE, Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.moves import GraphMoves, Moves, TableMoves, action_mask
from mlivr_gym.stances.pair_graph import PairGraph
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.stances.step_tables import step_tables
from mlivr_gym.transitions.state import State, Successors
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap, as_map

if TYPE_CHECKING:
    from mlivr_gym.simulation.dynamics import Physics
    from mlivr_gym.simulation.physical_walk import PhysicalWalk

OPTIONS = ("start", "start_pose", "start_joints", "goal")
"""Names of the options of `reset`."""

DYNAMICS = ("kinematic", "mujoco")
"""Names of the kinds of dynamics."""

REMEMBERED = 4096
"""Stances whose observation an environment remembers."""


class MlivrEnv(PlainSpec, gymnasium.Env[Any, Any]):
    """Hand-over-hand motion of a multi-limbed robot through a space station module.

    ## Description The robot holds one graspable point with each of its N limbs. An action moves one
    limb to another point; the base follows to the posture that belongs to the new stance. The task
    is to bring the base within `goal_tolerance` of a goal position.

    ## Action Space `Discrete(N * m)` for m points: action `limb * m + point` moves `limb` to
    `point`. Few actions are possible in a stance; `action_masks()` (bool) and `info["action_mask"]`
    (int8) tell which. An action that is masked out changes nothing, costs the same as a step, and
    sets `info["invalid_action"]`.

    ## Observation Space
    A dictionary:

    | key | space | meaning |
    |---|---|---|
    | `stance` | `MultiDiscrete([m] * N)` | point each limb holds |
    | `grasps` | `Box(3 N)` | positions x, y, z of those points [m] |
    | `base_position` | `Box(3)` | base position [m] |
    | `base_quaternion` | `Box(4)` | base orientation w, x, y, z, with w >= 0 |
    | `goal` | `Box(3)` | goal position [m] |
    | `branches` | `MultiBinary(16 N)` | inverse-kinematics branches and flips each limb may still be on |

    ## Rewards `reward="steps"`: -1 a step. `reward="base"`: minus the base displacement [m]; a
    masked-out action costs `max_step`, the largest displacement of any step. `success_bonus` is
    added on reaching the goal. With `shaping=True`, `discount * phi(after) - phi(before)` is added,
    where `phi` is minus the distance to the goal [m] (0 at the goal); this keeps the optimal policy
    of an agent with the same discount. Without shaping the return of an episode without masked-out
    actions is minus the cost of the plan, plus the bonus.

    ## Starting State `reset(options={"start": (ids...), "goal": (x, y, z)})`; what is not given is
    drawn from the seed such that a walk of possible steps joins start and goal. With a start,
    `start_pose` (x, y, z [m] and quaternion w, x, y, z) is the base pose of a robot that does not
    stand in the stance's own posture, `start_joints` (N, 6) [rad] are its joint angles. With
    `dynamics="mujoco"`, `options={"plan": plan}` starts where a plan starts, with its goal, and
    uses its joint angles and swings for as long as the actions follow it.

    ## Episode End Terminated when the base is within `goal_tolerance` of the goal, or, with
    `dynamics="mujoco"`, when a step fails; the observation is then still that of the stance before.
    Truncated after `max_episode_steps` of the registration (100).

    ## Information `stance` (point ids), `base_position` [m], `base_translation` [m] and `steps`
    since reset, `limb_manipulability` (N,), `base_manipulability`, `action_mask` (int8),
    `is_success`, `invalid_action`, `grasp_failed`. With `dynamics="mujoco"` also `failure` (None,
    or a dictionary as in `recording.Failure`) and of the last step `capture_distance` [m],
    `capture_angle` [rad], `peak_torque` [N m], `torque_rms` (largest over time) [N m],
    `peak_grasp_force` [N], `peak_grasp_torque` [N m], `base_error` [m], and `simulated_time` since
    reset [s].

    ## Dynamics `"kinematic"`: a step is the transition of the stance graph. `"mujoco"`: it is
    carried out by a PD controller in MuJoCo, where each limb is on one branch with one winding,
    chosen when it lands; `branches` then has one bit a limb and the mask leaves out steps in which
    a limb that holds would leave its joint limits.

    ## Unreliable grasps With `grasp_failure` above 0 an attempt to take hold of a point fails with
    that point's probability (`failure_probability`). The base then goes back the way it came and
    the limb takes hold of the point it left: the attempt costs a step and twice the base
    displacement, and `info["grasp_failed"]` is True.

    ## Arguments
    See `__init__`.

    ## Version History
    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 2}

    def __init__(
        self,
        robot: str | RobotSpec | dict[str, Any] = "mlivr2",
        map: str | Path | GraspMap | dict[str, Any] | None = None,
        manipulability: bool = True,
        transitions: bool = True,
        limb_threshold: float = 0.1,
        base_threshold: float | None = None,
        collisions: bool = True,
        clearance: float = CLEARANCE,
        goal_tolerance: float = 0.2,
        reward: str | Reward | dict[str, Any] = "steps",
        success_bonus: float = 0.0,
        shaping: bool = False,
        discount: float = 0.99,
        tasks: str | TaskGenerator | dict[str, Any] = "walk",
        dynamics: str = "kinematic",
        step_duration: float = 50.0,
        physics: Physics | dict[str, Any] | None = None,
        grasp_failure: float | NDArray[np.float64] = 0.0,
        grasp_failure_seed: int = 0,
        precompute: bool = False,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 360,
    ) -> None:
        """Build the stance graph and the spaces.

        Args:
            robot: Name, path of a JSON file, or description of the robot, also as plain data
                (`RobotSpec.to_dict`).
            map: Path of a map file, or a map, also as plain data (`GraspMap.to_dict`); by default
                the measured JEM.
            manipulability: Whether stances must meet both thresholds.
            transitions: Whether steps must be shown to be possible.
            limb_threshold: Least limb manipulability.
            base_threshold: Least base manipulability; by default `0.001 (2/N)^3`.
            collisions: Whether stances and steps must touch nothing; False reproduces the paper.
            clearance: Least distance between shapes [m].
            goal_tolerance: Radius of the goal region [m].
            reward: `"steps"`, `"base"`, or an object as in `envs.rewards`.
            success_bonus: Added on reaching the goal.
            shaping: Whether to add potential-based shaping.
            discount: Discount used by the shaping.
            tasks: What draws starts and goals: `"walk"`, or an object as in `envs.tasks`.
            dynamics: `"kinematic"`: the step of the stance graph; `"mujoco"`: carried out in
                simulation.
            step_duration: Duration of a step that is carried out [s].
            physics: Controller, grasps and failures of steps that are carried out, also as plain
                data (`Physics.from_dict`).
            grasp_failure: Mean probability that an attempt to take hold of a point fails, or one
                for each point, see `failure_probabilities`; with `dynamics="kinematic"` only.
            grasp_failure_seed: Seed of the probabilities; whether an attempt fails is drawn from
                the environment's own.
            precompute: Whether to check every step beforehand, which makes each one fast; takes
                minutes for the JEM, once, and is kept on disk. Two limbs and `dynamics="kinematic"`
                only.
            render_mode: `"rgb_array"`, `"human"` or None.
            width: Width of rendered pictures [px].
            height: Height of rendered pictures [px].

        Raises:
            MlivrError: If an argument cannot be used; the message names it.
        """
        choice("dynamics", dynamics, DYNAMICS)
        if dynamics == "mujoco" and not transitions:
            raise SettingError(
                "dynamics='mujoco' needs transitions=True: unchecked steps cannot be executed"
            )
        if render_mode is not None:
            choice("render_mode", render_mode, self.metadata["render_modes"])
        if not 0.0 < discount <= 1.0:
            raise SettingError(f"discount is {discount!r}; it must be above 0 and at most 1")
        tolerance = nonnegative("goal_tolerance", goal_tolerance)
        self.reward = TaskReward(
            reward_of(reward), float(success_bonus), bool(shaping), float(discount), tolerance
        )
        self.goal_tolerance, self.tasks = tolerance, generator_of(tasks)
        self.render_mode, self._size = render_mode, (int(width), int(height))
        settings = Settings(
            manipulability, transitions, limb_threshold, base_threshold, collisions=collisions,
            clearance=clearance,
        )  # fmt: skip
        self.graph = stance_graph(as_map(map), robot_spec(robot), settings)
        points = len(self.graph.grasp_map)
        self.action_space = spaces.Discrete(self.graph.limbs * points)
        self.observation_space = observation_space(self.graph)
        self._walk: PhysicalWalk | None = None
        if dynamics == "mujoco":
            if precompute or np.any(np.asarray(grasp_failure) > 0.0):
                raise SettingError("precompute and grasp_failure need dynamics='kinematic'")
            self._walk = _physical_walk(self.graph, step_duration, physics)
        self.failure_probability = failure_probabilities(points, grasp_failure, grasp_failure_seed)
        self.precompute = bool(precompute)
        self._moves: Moves | None = None
        self._version = self.graph.version
        if self.precompute:
            self.table_moves()
        self._state: State | None = None
        self._measures: dict[str, Any] = {}
        self._seen: dict[tuple[int, ...], PlaceObservation] = {}
        self._viewer: Any = None
        self._drawn: tuple[Box, ...] = ()

    @property
    def moves(self) -> Moves:
        """What answers for the world as it is now."""
        if self._moves is None or self._version != self.graph.version:
            self._version = self.graph.version
            if self.precompute and isinstance(self.graph, PairGraph):
                self._moves = TableMoves(self.graph, step_tables(self.graph))
            else:
                self._moves = GraphMoves(self.graph)
        return self._moves

    def table_moves(self) -> TableMoves:
        """The same from exact tables, which are used from now on.

        Raises:
            SettingError: If the robot has more than two limbs.
        """
        if not (self.precompute and isinstance(self._moves, TableMoves)):
            tables = step_tables(self.graph)
            assert isinstance(self.graph, PairGraph)
            self.precompute, self._moves = True, TableMoves(self.graph, tables)
            self._version = self.graph.version
        moves = self.moves
        assert isinstance(moves, TableMoves)
        return moves

    @property
    def state(self) -> State:
        """The present state.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset() before using the environment")
        return self._state

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; see the class for `options`."""
        super().reset(seed=seed)
        given = dict(options or {})
        valid = (*OPTIONS, "plan") if self._walk is not None else OPTIONS
        for name in given:
            choice("reset option", name, valid)
        plan = given.pop("plan", None)
        if plan is not None:
            first = plan.motion.base_positions[0], plan.motion.base_quaternions[0]
            pose = self.graph.given_pose_of(plan.stances[0], *first)
            goal = plan.query.goal
            given = {"start": plan.stances[0], "start_pose": pose, "goal": goal, **given}
        start = self._start(given)
        self.goal: Array
        if "goal" in given:
            self.goal = self.graph.grasp_map.check_goal(given["goal"])
        if start is None or "goal" not in given:
            task = self.tasks.draw(self.graph, self.np_random, self.goal_tolerance, start)
            start = task.start if start is None else start
            self.goal = self.goal if "goal" in given else task.goal
        if self._walk is not None:
            start = self._walk.start(start, plan, given.get("start_joints"))
            self._measures = self._walk.measures
        self._enter(start)
        if not self._mask.any():
            raise StanceError(f"no step leaves the start stance {self.graph.ids(start.stance)}")
        self.steps, self.base_translation = 0, 0.0
        if self.render_mode == "human":
            self.render()
        return self._observation(), self._info(False)

    def _start(self, given: dict[str, Any]) -> State | None:
        """The start that the options of `reset` give, if they give one."""
        start, pose, joints = (given.get(name) for name in OPTIONS[:3])
        if start is None:
            if pose is not None or joints is not None:
                raise SettingError(
                    "reset options 'start_pose' and 'start_joints' need 'start', the stance they "
                    "belong to"
                )
            return None
        return self.graph.state(start, pose, joints)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move limb `action // m` to point `action % m`.

        Args:
            action: A whole number: an int, or an integer array or tensor without axes.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset, and after a step that failed.
            SettingError: If the action is not in the action space.
        """
        state, n = self.state, int(self.action_space.n)  # type: ignore[attr-defined]
        if self._measures.get("failure"):
            raise gymnasium.error.ResetNeeded("the last step failed: call reset()")
        action = action_number(action, n)
        limb, point = divmod(action, n // self.graph.limbs)
        legal, moved, failed = bool(self._mask[action]), self.graph.max_step, False
        before = self._distance()
        self.steps += 1
        if legal:
            after = self.moves.take(state, action)
            moved = math.dist(self.moves.place(after).position, self._place.position)
            risk = self.failure_probability[point]
            failed = bool(risk > 0.0 and self.np_random.random() < risk)
            if failed:
                moved, after = 2.0 * moved, self._went_back(after, limb)
            if self._walk is not None:
                after, _ = self._walk.step(limb, point, after.masks)
                self._measures = self._walk.measures
            if self._walk is None or after.stance != state.stance:
                self._enter(after)
                self.base_translation += moved
        distance = self._distance()
        success = distance <= self.goal_tolerance
        reward = self.reward(StepOutcome(moved, before, distance, success, legal))
        if self.render_mode == "human":
            self.render()
        ended = success or bool(self._measures.get("failure"))
        return self._observation(), float(reward), ended, False, self._info(not legal, failed)

    def _went_back(self, after: State, limb: int) -> State:
        """The state after a grasp has failed that would have led to `after`: `limb` holds again."""
        grasped = self.graph.mask_after_grasp(self.state, limb)
        return self.state._replace(masks=(*after.masks[:limb], grasped, *after.masks[limb + 1 :]))

    def action_masks(self) -> BoolArray:
        """Which actions are allowed, shape (N m,).

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset() before action_masks()")
        return self._mask.copy()

    def successors(self) -> Successors:
        """The steps that leave the present state; with MuJoCo, those that are executable."""
        steps = self.moves.successors(self.state)
        return steps if self._walk is None else self._walk.executable(steps)

    def _enter(self, state: State) -> None:
        self._state, self._place = state, self.moves.place(state)
        if self._walk is None:
            self._mask = self.moves.mask(state)
        else:
            self._mask = action_mask(self.graph, self.successors())

    def _distance(self) -> float:
        return math.dist(self._place.position, self.goal)

    def _observation(self) -> Observation:
        state = self.state
        seen = self._seen.get(state.stance) if state.pose is None else None
        if seen is None:
            seen = place_observation(self.graph, state.stance, self._place)
            if state.pose is None:
                if len(self._seen) >= REMEMBERED:
                    self._seen.clear()
                self._seen[state.stance] = seen
        return observation(seen, state, self.goal)

    def _info(self, invalid: bool, failed: bool = False) -> dict[str, Any]:
        place = self._place
        return {
            "stance": place.ids,
            "base_position": np.array(place.position),
            "base_translation": self.base_translation,
            "steps": self.steps,
            "limb_manipulability": place.w_m.copy(),
            "base_manipulability": place.w_b,
            "action_mask": self._mask.astype(np.int8),
            "is_success": self._distance() <= self.goal_tolerance,
            "invalid_action": invalid,
            **self._measures,
            "grasp_failed": failed,
        }

    def render(self) -> NDArray[np.uint8] | None:
        """Picture of the scene with the obstacles of now, shape (height, width, 3), or the scene in a window.

        Raises:
            RenderError: If there is no GL library.
        """
        if self.render_mode is None:
            gymnasium.logger.warn(
                "render() was called without a render_mode; give one to gymnasium.make"
            )
            return None
        graph = self.graph
        configuration = (
            graph.configuration(self.state) if self._walk is None else self._walk.configuration
        )
        if self._viewer is None or self._drawn != graph.obstacles:
            from mlivr_gym.pictures.rendering import SceneRenderer, SceneWindow

            self.close()
            if self.render_mode == "human":
                self._viewer = SceneWindow(graph.grasp_map, graph.robot, graph.obstacles)
            else:
                self._viewer = SceneRenderer(
                    graph.grasp_map, graph.robot, *self._size, graph.obstacles
                )
            self._drawn = graph.obstacles
        if self.render_mode == "human":
            self._viewer.show(*configuration)
            return None
        picture: NDArray[np.uint8] = self._viewer.render(*configuration)
        return picture

    def close(self) -> None:
        """Release the window or GL context."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None

    def __getstate__(self) -> dict[str, Any]:
        """Everything but the window or GL context."""
        return self.__dict__ | {"_viewer": None}


def _physical_walk(
    graph: StanceGraph, step_duration: float, physics: Physics | dict[str, Any] | None
) -> PhysicalWalk:
    """What executes steps in MuJoCo, which is loaded only where it is wanted."""
    from mlivr_gym.simulation.dynamics import Physics
    from mlivr_gym.simulation.physical_walk import PhysicalWalk

    physics = physics if isinstance(physics, Physics) else Physics.from_dict(physics or {})
    return PhysicalWalk(graph, Durations.of_step(step_duration), physics)
