"""The Gymnasium environment `MLIVR-JEM-v0`, the first version of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mlivr_gym.arguments import checked
from mlivr_gym.arrays import Array, BoolArray
from mlivr_gym.envs.actions import action_number
from mlivr_gym.envs.arguments import ENV
from mlivr_gym.envs.batch import draw_over
from mlivr_gym.envs.current_moves import CurrentMoves
from mlivr_gym.envs.dynamics import check_dynamics, physical_walk
from mlivr_gym.envs.grasp_failure import failure_probabilities
from mlivr_gym.envs.moments import Moment, Motion, at_rest, motion_of, words
from mlivr_gym.envs.observations import Observation, Observer, observation_space
from mlivr_gym.envs.plain_spec import PlainSpec
from mlivr_gym.envs.reset_options import ResetOptions
from mlivr_gym.envs.rewards import REWARD, Reward, StepOutcome, TaskReward
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.tasks import TASKS, TaskGenerator, fixed_task
from mlivr_gym.envs.viewer import RENDER_FPS, EnvViewer
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.kinematics.batches import distance
from mlivr_gym.robot.specification import RobotSpec, robot_spec
from mlivr_gym.schema import FieldPath
from mlivr_gym.settings import CLEARANCE, Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.stances.moves import Moves, TableMoves
from mlivr_gym.transitions.state import State, Successors
from mlivr_gym.world.grasp_map import GraspMap, as_map

if TYPE_CHECKING:
    from mlivr_gym.simulation.controller import Controller
    from mlivr_gym.simulation.disturbances import Disturbances
    from mlivr_gym.simulation.dynamics import Physics
    from mlivr_gym.simulation.limits import Limits
    from mlivr_gym.simulation.physical_walk import PhysicalWalk


class MlivrEnv(PlainSpec, gymnasium.Env[Any, Any]):
    """Hand-over-hand motion of a multi-limbed robot through a space station module.

    ## Description
    The robot holds one graspable point with each of its N limbs. An action moves one limb to
    another point; the base follows to the posture that belongs to the new stance. The task is to
    bring the base within `goal_tolerance` of a goal position.

    ## Action Space
    `Discrete(N * m)` for m points: action `limb * m + point` moves `limb` to `point`. Few actions
    are allowed in a stance; `action_masks()` (bool) and `info["action_mask"]` (int8) tell which. An
    action that is masked out changes nothing, costs the same as a step, and sets
    `info["invalid_action"]`.

    ## Observation Space
    A dictionary, see `envs.observations.Observation`:

    | key | space | meaning |
    |---|---|---|
    | `stance` | `MultiDiscrete([m] * N)` | point each limb holds |
    | `grasps` | `Box(3 N)` | positions x, y, z of those points [m] |
    | `base_position` | `Box(3)` | base position [m] |
    | `base_quaternion` | `Box(4)` | base orientation w, x, y, z, with w >= 0 |
    | `goal` | `Box(3)` | goal position [m] |
    | `branches` | `MultiBinary(16 N)` | branches and flips each limb may still be on |

    ## Rewards
    `reward="steps"`: -1 a step. `reward="base"`: minus the base displacement [m]; a masked-out
    action costs `max_step`, the largest displacement of any step. An object in place of the name is
    called with the `envs.rewards.StepOutcome` of a step and returns its reward. `success_bonus` is
    added on reaching the goal. With `shaping=True`, `discount * phi(after) - phi(before)` is added,
    where `phi` is minus the distance to the goal [m] (0 at the goal); this keeps the optimal policy
    of an agent with the same discount. Without shaping the return of an episode without masked-out
    actions is minus the cost of the plan, plus the bonus.

    ## Starting State
    `reset(options={"start": (ids...), "goal": (x, y, z)})`; what is not given is drawn from the
    seed by `tasks`. With `tasks="walk"` a walk of allowed steps joins start and goal, with
    `tasks="far"` (`MLIVR-JEM-Far-v0`) one that leads into the other half of the module.
    `options={"task": k}` is the fixed task k, the same in every process. An object in place of the
    name has the method `draw` of `envs.tasks.TaskGenerator`, which returns a start and
    a goal. With a start, `start_pose` (x, y, z [m] and quaternion w, x, y, z) is the base pose of a
    robot that does not stand in the posture of the stance, `start_joints` (N, 6) [rad] are its
    joint angles. With `dynamics="mujoco"`, `options={"plan": plan}` starts where a plan starts,
    with its goal, and uses its joint angles and swings for as long as the actions follow it.

    ## Episode End
    Terminated when the base is within `goal_tolerance` of the goal, or, with `dynamics="mujoco"`,
    when a step fails; the observation is then still that of the stance before. Truncated after
    `max_episode_steps` of the registration (100).

    ## Information
    `stance` (point ids), `base_position` [m], `base_translation` [m] and `steps` since reset,
    `limb_manipulability` (N,), `base_manipulability`, `action_mask` (int8), `is_success`,
    `invalid_action`, `grasp_failed`. With `dynamics="mujoco"` also `failure` (None, or a dictionary
    as in `recording.Failure`) and of the last step `capture_distance` [m], `capture_angle` [rad],
    `peak_torque` [N m], `torque_rms` (largest over time) [N m], `peak_grasp_force` [N],
    `peak_grasp_torque` [N m], `base_error` [m], `tries`, `step_time`, `simulated_time` [s].

    ## Dynamics
    `"kinematic"`: a step is the transition of the stance graph. `"mujoco"`: it is executed in
    MuJoCo, where each limb is on one branch, chosen when it grasps (`branches` has one bit a limb);
    with `disturbances` each episode has a robot and a module that the controller mistakes.

    ## Unreliable Grasps
    With `grasp_failure` above 0 an attempt to grasp a point fails if the next number of the stream
    is below that point's `failure_probability`. The base then goes back along its path and the limb
    grasps the point that it released: the attempt costs a step and twice the base displacement, and
    `info["grasp_failed"]` is True. Limbs that hold are then on the branches that the step allows,
    the limb that went back on all on which it can be released.

    ## Random Numbers
    Tasks and failures are drawn from one `envs.streams.Stream`, begun with the seed of `reset` if
    there is one. Copy i of `MlivrVectorEnv` draws as with seed + i.

    ## Rendering
    `"rgb_array"`: a picture of the present stance, shape (height, width, 3), with goal and words.
    `"rgb_array_list"`: the film since the last call of `render`, 25 pictures an action, 25 a
    second; the first of an episode has one more. `envs.wrappers.RecordVideo` writes such films.

    ## Changing World
    When points or obstacles of `graph` change in an episode, masks and steps are those of the new
    world. The robot stays where it is; if no step is left, every action is masked out.

    ## Version History
    * v0: first version. What an episode is also rests on the rules of the stance graph,
      `settings.GRAPH_RULES`, whose number goes up when they change.

    Attributes
    ----------
    graph
        The stance graph.
    reward
        The whole reward, with bonus and shaping.
    tasks
        What draws starts and goals.
    goal_tolerance
        Radius of the goal region [m].
    failure_probability
        Probability that an attempt to grasp each point fails, shape (m,).
    goal
        Goal position [m], shape (3,).
    steps
        Steps since reset.
    base_translation
        Sum of base displacements since reset [m].
    """

    metadata = {"render_modes": list(RENDER_FPS), "render_fps": 2}  # noqa: RUF012
    goal: Array
    _state: State | None
    _happened: tuple[str, Motion | None]
    steps: int
    base_translation: float

    @checked(ENV)
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
        limits: Limits | dict[str, Any] | str | None = None,
        controller: Controller | dict[str, Any] | str | None = None,
        disturbances: Disturbances | dict[str, Any] | str | None = None,
        physics: Physics | dict[str, Any] | None = None,
        grasp_failure: float | NDArray[np.float64] = 0.0,
        grasp_failure_seed: int = 0,
        precompute: bool = False,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 360,
    ) -> None:
        """Build the stance graph and the spaces.

        Parameters
        ----------
        robot
            Name, path of a JSON file, or description of the robot, also as plain data.
        map
            Path of a map file, or a map, also as plain data; by default the measured JEM.
        manipulability
            Whether stances must meet both thresholds.
        transitions
            Whether steps must be checked, rather than taken to be possible.
        limb_threshold
            Least limb manipulability.
        base_threshold
            Least base manipulability; by default `0.001 (2/N)^3`.
        collisions
            Whether stances and steps must touch nothing; False reproduces the paper.
        clearance
            Least distance between shapes [m].
        goal_tolerance
            Radius of the goal region [m].
        reward
            `"steps"`, `"base"`, or an `envs.rewards.Reward`, also as plain data.
        success_bonus
            Added on reaching the goal.
        shaping
            Whether to add potential-based shaping.
        discount
            Discount used by the shaping.
        tasks
            What draws starts and goals: `"walk"`, `"far"`, or an `envs.tasks.TaskGenerator`.
        dynamics
            `"kinematic"`: the step of the stance graph; `"mujoco"`: executed.
        limits
            How fast; this and the next three see `Setup.of`: `"fast"`, `"gentle"`.
        controller
            `"full"`, `"feedforward"`, `"paper"`.
        disturbances
            `"none"`, `"all"`; each episode draws anew.
        physics
            Figures of grasps and failures.
        grasp_failure
            Mean probability that a grasp fails, or each point's; kinematic only.
        grasp_failure_seed
            Seed of the probabilities.
        precompute
            Whether to call `table_moves` at once. Two limbs, kinematic, only.
        render_mode
            `"rgb_array"`, `"rgb_array_list"`, `"human"` or None.
        width
            Width of rendered pictures [px].
        height
            Height of rendered pictures [px].

        Raises
        ------
        MlivrError
            If an argument cannot be used; the message names it.
        """
        checks = {"transitions": transitions, "precompute": precompute}
        check_dynamics(dynamics, **checks, grasp_failure=grasp_failure)
        if render_mode is not None:
            self.metadata = self.metadata | {"render_fps": RENDER_FPS[render_mode]}
        worth = REWARD.read(reward, FieldPath("reward", SettingError))
        self.goal_tolerance = goal_tolerance
        self.reward = TaskReward(worth, success_bonus, shaping, discount, goal_tolerance)
        self.tasks, self.render_mode = (
            TASKS.read(tasks, FieldPath("tasks", SettingError)),
            render_mode,
        )
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
            how = {"limits": limits, "controller": controller, "physics": physics}
            self._walk = physical_walk(self.graph, **how, disturbances=disturbances)
        self.failure_probability = failure_probabilities(points, grasp_failure, grasp_failure_seed)
        self._moves, self._observer = CurrentMoves(self.graph), Observer(self.graph)
        if precompute:
            self.table_moves()
        self._state, self._stream, self._seeded = None, Stream(0), False
        self._entered, self._measures = self.graph.version, dict[str, Any]()
        self.viewer = EnvViewer(self.graph, (width, height), self.goal_tolerance)

    @property
    def moves(self) -> Moves:
        """What answers for the world as it is now."""
        return self._moves.now()

    def table_moves(self) -> TableMoves:
        """The same from exact tables, which are used from now on.

        Raises
        ------
        SettingError
            If the robot has more than two limbs.
        """
        return self._moves.from_tables()

    @property
    def state(self) -> State:
        """The present state.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset.
        """
        if self._state is None:
            raise gymnasium.error.ResetNeeded("call reset() before using the environment")
        return self._state

    @checked(ENV)
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; see the class. A goal alone takes the start of a drawn task."""
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            number = int(self.np_random.integers(2**63)) if seed is None else seed
            self._stream, self._seeded = Stream.of_seed(number), True
        graph, walk = self.graph, self._walk
        given = ResetOptions.of(options, graph, plans=walk is not None)
        start, goal = given.state(graph), given.goal
        if given.task is not None:
            start, goal = fixed_task(self.tasks, graph, given.task, self.goal_tolerance)
        goal = None if goal is None else graph.grasp_map.check_goal(goal)
        if start is None or goal is None:
            task = draw_over(self.moves, self.tasks, self._stream, self.goal_tolerance, start)
            start, goal = start or task.start, task.goal if goal is None else goal
        if walk is not None:
            start = walk.start(start, given.plan, walk.draw(self._stream))
            self._measures = walk.measures
        if not self.moves.successors(start):
            raise StanceError(f"no step leaves the start stance {graph.ids(start.stance)}")
        self.goal = goal
        self._enter(start)
        self.steps, self.base_translation = 0, 0.0
        self._show("the start", None if walk is None else at_rest(walk.configuration))
        return self._observation(), self._info(False)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move limb `action // m` to point `action % m`.

        Parameters
        ----------
        action
            A whole number: an int, or an integer array or tensor without axes.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset, and after a step that failed.
        SettingError
            If the action is not in the action space.
        """
        self._keep_up()
        state, points = self.state, len(self.graph.grasp_map)
        if self._measures.get("failure"):
            raise gymnasium.error.ResetNeeded("the last step failed: call reset()")
        action = action_number(action, self.graph.limbs * points)
        limb, point = divmod(action, points)
        legal, moved, failed = bool(self._mask[action]), self.graph.max_step, False
        before = self._distance
        self.steps, simulated = self.steps + 1, None
        if legal:
            after = self.moves.take(state, action)
            moved = distance(self.moves.place(after).base_in_world, self._place.base_in_world)
            risk = self.failure_probability[point]
            failed = bool(risk > 0.0 and self._stream.random() < risk)
            if failed:
                moved, after = 2.0 * moved, self._went_back(after, limb)
            if self._walk is not None:
                after, executed = self._walk.step(limb, point, after.masks)
                self._measures, simulated = self._walk.measures, motion_of(executed)
            if self._walk is None or after.stance != state.stance:
                self._enter(after)
                self.base_translation += moved
        success = self._distance <= self.goal_tolerance
        reward = self.reward(StepOutcome(moved, before, self._distance, success, legal))
        self._show(words(self.graph, (limb, point), legal, failed), simulated)
        ended = success or bool(self._measures.get("failure"))
        return self._observation(), float(reward), ended, False, self._info(not legal, failed)

    def _went_back(self, after: State, limb: int) -> State:
        """The state after a grasp has failed that would have led to `after`: `limb` holds again."""
        grasped = self.graph.mask_after_grasp(self.state, limb)
        return self.state._replace(masks=(*after.masks[:limb], grasped, *after.masks[limb + 1 :]))

    def action_masks(self) -> BoolArray:
        """Which actions are allowed, shape (N m,).

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset.
        """
        self._keep_up()
        return self._mask.copy()

    def successors(self) -> Successors:
        """The steps that leave the present state."""
        return self.moves.successors(self.state)

    def _keep_up(self) -> None:
        """Look at the present state anew if the world has changed."""
        if self._entered != self.graph.version or self._state is None:
            self._enter(self.state)

    def _enter(self, state: State) -> None:
        self._entered = self.graph.version
        self._state, self._place = state, self.moves.place(state)
        self._distance = distance(self._place.base_in_world, self.goal.tolist())
        self._mask = self.moves.mask(state)

    def _observation(self) -> Observation:
        return self._observer.observation(self.moves, self.state, self._place, self.goal)

    def _info(self, invalid: bool, failed: bool = False) -> dict[str, Any]:
        place = self._place
        return {
            "stance": place.ids,
            "base_position": np.array(place.base_in_world),
            "base_translation": self.base_translation,
            "steps": self.steps,
            "limb_manipulability": place.w_m.copy(),
            "base_manipulability": place.w_b,
            "action_mask": self._mask.astype(np.int8),
            "is_success": self._distance <= self.goal_tolerance,
            "invalid_action": invalid,
            **self._measures,
            "grasp_failed": failed,
        }

    @property
    def moment(self) -> Moment:
        """What pictures show of the environment as it is now."""
        return Moment(self.state, self.goal, self.steps, *self._happened)

    def _show(self, words: str, simulated: Motion | None) -> None:
        """Take note of what happened, and show it in a window."""
        self._happened = words, simulated
        self.viewer.follow(self.moment, self.render_mode)

    def render(self) -> Any:
        """The scene, see the class; raises `RenderError` without GL, or a screen for a window."""
        return self.viewer.render(self.moment, self.render_mode)

    def close(self) -> None:
        """Release the window or GL context."""
        self.viewer.close()
