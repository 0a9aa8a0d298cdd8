"""The Gymnasium environment of all ids: a multi-limbed robot climbs to a goal, step by step.

The environment joins parts that are objects of their own: `rewards`, `tasks`, `observations`, the
steps of a stance graph (`moves`), and pictures (`viewer`). `vector_env` steps many at once.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from mlivr_gym.arguments import checked
from mlivr_gym.envs.actions import action_number
from mlivr_gym.envs.arguments import ENV_ARGUMENTS
from mlivr_gym.envs.batch import draw_task_with_tables
from mlivr_gym.envs.dynamics import check_dynamics
from mlivr_gym.envs.grasp_failure import failure_probabilities, state_after_failure
from mlivr_gym.envs.layout_tasks import LayoutTasks, fewest_steps
from mlivr_gym.envs.observations import Observation
from mlivr_gym.envs.regret import EpisodeRegret
from mlivr_gym.envs.reset_options import ResetOptions
from mlivr_gym.envs.rewards import REWARD, Reward, StepOutcome, TotalReward
from mlivr_gym.envs.snapshots import Motion, action_caption, motion_at_rest, recorded_motion
from mlivr_gym.envs.stance_graph_env import StanceGraphEnv
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.task import Task, TaskGenerator
from mlivr_gym.envs.tasks import TASKS
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.robot.specification import RobotSpec, robot_spec
from mlivr_gym.schema import FieldPath
from mlivr_gym.settings import CLEARANCE, Settings
from mlivr_gym.stances.build import stance_graph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GraspMap, as_map

if TYPE_CHECKING:
    from mlivr_gym.simulation.disturbances import DisturbanceRanges
    from mlivr_gym.simulation.parameters import ControllerParameters, Limits, Physics
    from mlivr_gym.simulation.step_executor import StepExecutor


class Attempt(NamedTuple):
    """What came of a valid action."""

    after: State
    """The state after it."""
    displacement: float = 0.0
    """Base displacement [m]."""
    grasp_failed: bool = False
    """Whether a grasp failed, and the limb is back on the point that it left."""
    simulated: Motion | None = None
    """The motion in simulation."""
    caption: str | None = None
    """Text about an action that is no step."""
    reward: Reward | None = None
    """Its reward, in place of that of a step."""
    is_end: bool = False
    """Whether it ends the episode."""


class MlivrEnv(StanceGraphEnv):
    """Hand-over-hand climbing of a multi-limbed robot through a space station module.

    ## Description
    The robot holds one graspable point with each of its N limbs. An action is one step: a limb
    moves to another point while the support limbs hold, and the base moves to the pose that belongs
    to the new stance. The task is to bring the base within `goal_tolerance` of a goal position.

    With `dynamics="kinematic"` a step is a transition of the stance graph. With `dynamics="mujoco"`
    a controller executes it in MuJoCo, and each limb is on one branch of inverse kinematics, which
    is chosen when it grasps a point (`branches` then has one bit for each limb). Simulation decides
    whether a step fails. Observation, goal test and reward of a step that does not fail use the
    base pose that was planned for the new stance; `base_error` is the simulated base's distance
    from its trajectory.

    With `grasp_failure` above 0 an attempt to grasp a point fails with that point's
    `failure_probability`. The base then returns along its path, and the limb grasps the point that
    it released. The attempt costs a step and twice the base displacement. The limb may then be
    on all branches on which it can be released, the support limbs on those that they keep on the
    step.

    ## Action Space
    `Discrete(N * m)` for m graspable points: action `limb * m + point` moves `limb` to `point`. Few
    actions are *valid* in a state: those for which the robot can make the step, marked in
    `action_masks()` (bool) and `info["action_mask"]` (int8). An *invalid* action changes nothing,
    counts as a step, and sets `info["invalid_action"]`.

    When points are occupied or obstacles are added to `graph` during an episode, the mask becomes
    that of the new world. The robot stays where it is; if no step leaves its state, all
    actions are invalid. In an unchanged world at least one action is valid in every state.

    ## Observation Space
    A dictionary, see `envs.observations.Observation`:

    | key | space | meaning | unit |
    |---|---|---|---|
    | `stance` | `MultiDiscrete([m] * N)` | index of the point that each limb holds | |
    | `grasps` | `Box(3 N)` | positions x, y, z of these points | m |
    | `base_position` | `Box(3)` | position of the base | m |
    | `base_quaternion` | `Box(4)` | orientation of the base w, x, y, z, with w >= 0 | 1 |
    | `goal` | `Box(3)` | goal position of the base | m |
    | `branches` | `MultiBinary(16 N)` | inverse kinematics branches and flips of each limb | |
    | `occupied` | `MultiBinary(m)` | occupied points, with `LayoutTasks` only | |

    ## Rewards
    `reward="steps"` gives -1 for each action. `reward="base"` gives minus the base displacement
    [m], and for an invalid action minus `graph.max_displacement`, an upper bound of the base
    displacement of a step. A step that fails in simulation counts as a step, with the displacement
    of the base until the failure. An object as `reward` is called with the
    `envs.rewards.StepOutcome` and returns the reward. `success_bonus` is added when the goal is
    reached. Without shaping the
    undiscounted return of an episode without invalid actions is minus the cost of its steps, plus
    the bonus. With `dynamics="mujoco"` a failed step ends the episode, so give a bonus, or an agent
    gains by failing early.

    With `shaping=True` the potential-based term `discount * phi(after) - phi(before)` is added,
    where `phi` is minus the distance to the goal [m], and 0 in the goal region. It keeps the
    optimal policy of an agent with the same discount where episodes end at the goal alone (Ng,
    Harada and Russell, 1999), not where a failed step in simulation ends them.

    ## Starting State
    `tasks` draws start and goal: `"walk"` such that a walk of valid steps joins them, `"far"`
    (`MLIVR-JEM-Far-v0`) with the goal in the other half of the module, `"anywhere"`
    (`MLIVR4-JEM-Anywhere-v0`) such that a plan joins them, and `"random"` (`MLIVR-Random-v0`) with
    a new layout of occupied points, as `"clutter"` does in clusters; it stays if both start and
    goal are given. Tasks, grasp failures and disturbances are drawn from
    one random stream, which the seed of `reset` starts, and which a reset without a seed continues.
    `reset(options=...)` takes:

    * `start`: ids of the points held, and `goal`: x, y, z [m]; one that is not given is drawn.
    * `start_pose`: x, y, z [m] and quaternion w, x, y, z, and `start_joints`, shape (N, 6) [rad],
      for a robot that is not in the posture of the stance `start`.
    * `task`: number of a fixed task, the same in every process, for evaluation.
    * `plan`, with `dynamics="mujoco"`: start and goal of a plan, whose joint angles and swings are
      used as long as the actions follow it.

    ## Episode End
    The episode terminates when the base is within `goal_tolerance` of the goal after an action or,
    with `dynamics="mujoco"`, when a step fails, with the observation of the stance before it. It is
    truncated after `max_episode_steps` of the registration (100) by `gymnasium.make`, and never
    if it is unwrapped.

    ## Information
    | key | meaning |
    |---|---|
    | `stance` | ids of the points held |
    | `base_position` | position of the base, shape (3,) [m] |
    | `base_translation`, `steps` | sum of base displacements [m], and actions, since the reset |
    | `limb_manipulability`, `base_manipulability` | w_m of each limb, shape (N,), and w_b |
    | `action_mask` | 1 for each valid action, shape (N m,), int8 |
    | `is_success` | whether the base is in the goal region |
    | `invalid_action`, `grasp_failed` | whether the action was invalid, or its grasp failed |
    | `fewest_steps` | with `LayoutTasks`: steps of an optimal plan from the start, -1: none |
    | `optimal_cost`, `regret` | with `info_regret`: see `envs.regret`, infinite without a plan |

    With `dynamics="mujoco"` also `failure` (None, or a `recording.Failure` as a dictionary), and of
    the last step `capture_distance` [m], `capture_angle` [rad], `peak_torque`, `torque_rms` [N m],
    `peak_grasp_force` [N], `peak_grasp_torque` [N m], `base_error` [m], `step_time` and
    `simulated_time` [s].

    ## Arguments
    | argument | default | meaning |
    |---|---|---|
    | `robot` | `"mlivr2"` | name, path of a JSON, URDF or MJCF file, `RobotSpec`, or plain data |
    | `cargo` | None | `Cargo` on the body, or `{"mass": kg, "size": m}`; None: that of the robot |
    | `map` | None | name in `PLACES`, path of a file, `GraspMap`, or plain data; None: the JEM |
    | `manipulability` | True | whether stances must meet both thresholds |
    | `transitions` | True | whether steps are checked; if not, all are taken as valid |
    | `limb_threshold` | 0.1 | threshold of w_m |
    | `base_threshold` | None | threshold of w_b; by default `0.001 (2/N)^3` |
    | `collisions` | True | whether collisions are checked; False reproduces the paper |
    | `clearance` | 0.02 | minimum distance between shapes [m] |
    | `goal_tolerance` | 0.2 | radius of the goal region [m] |
    | `reward` | `"steps"` | `"steps"`, `"base"`, a `Cost`, or an `envs.rewards.Reward` |
    | `info_regret` | False | whether `info` has cost-to-go and regret; for rewards by a cost |
    | `success_bonus` | 0.0 | reward added when the goal is reached |
    | `shaping`, `discount` | False, 0.99 | whether to add shaping, and its discount |
    | `tasks` | `"walk"` | or `"far"`, `"anywhere"`, `"random"`, `"clutter"`, a `TaskGenerator` |
    | `dynamics` | `"kinematic"` | `"kinematic"` or `"mujoco"` |
    | `limits` | None | speed in MuJoCo: `"fast"`, `"gentle"`, `"careful"`, `"station"` |
    | `controller` | None | `"full"`, `"feedforward"`, `"paper"`, `"delayed"`, `"station"` |
    | `disturbances` | None | `"none"`, `"all"`, see `Setup.of`; drawn for each episode |
    | `physics` | None | grasps and failures: None or `"station"`, see `Setup.of` |
    | `grasp_failure` | 0.0 | mean failure probability, or that of each point; kinematic only |
    | `grasp_failure_seed` | 0 | seed of the failure probabilities |
    | `render_mode` | None | `"rgb_array"`, `"rgb_array_list"` (a film), or `"human"` (a window) |
    | `width`, `height` | 640, 360 | size of pictures [px] |

    With `dynamics="kinematic"` the arguments `limits`, `controller`, `disturbances` and `physics`
    have no effect. A film has the pictures since the last call of `render`, 10 for each action,
    which last a second.

    ## Version History
    * v0: first version. Episodes also depend on the rules of the stance graph, whose number
      `settings.GRAPH_RULES` goes up when they change.

    Attributes
    ----------
    graph
        The stance graph.
    reward
        The whole reward, with bonus and shaping.
    tasks
        The generator of starts and goals.
    goal_tolerance
        Radius of the goal region [m].
    failure_probability
        Probability that an attempt to grasp each point fails, shape (m,).
    goal
        Goal position, shape (3,) [m].
    steps
        Number of actions since the reset.
    base_translation
        Sum of base displacements since the reset [m].
    """

    @checked(ENV_ARGUMENTS)
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
        controller: ControllerParameters | dict[str, Any] | str | None = None,
        disturbances: DisturbanceRanges | dict[str, Any] | str | None = None,
        physics: Physics | dict[str, Any] | str | None = None,
        grasp_failure: float | NDArray[np.float64] = 0.0,
        grasp_failure_seed: int = 0,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 360,
        cargo: Cargo | dict[str, Any] | None = None,
        info_regret: bool = False,
    ) -> None:
        """Build the stance graph and the spaces; the class describes the arguments.

        Raises a `MlivrError` if an argument cannot be used; the message names it.
        """
        check_dynamics(dynamics, transitions=transitions, grasp_failure=grasp_failure)
        step_reward = REWARD.read(reward, FieldPath("reward", SettingError))
        self.reward = TotalReward(step_reward, success_bonus, shaping, discount, goal_tolerance)
        self.tasks = TASKS.read(tasks, FieldPath("tasks", SettingError))
        settings = Settings(
            manipulability, transitions, limb_threshold, base_threshold, collisions=collisions,
            clearance=clearance,
        )  # fmt: skip
        graph = stance_graph(as_map(map), robot_spec(robot).carrying(cargo), settings)
        layouts = isinstance(self.tasks, LayoutTasks)
        if layouts and not graph.lists_all:
            raise SettingError(
                f"tasks with layouts need two limbs; robot {graph.robot.name!r} has {graph.limbs}"
            )
        super().__init__(graph, goal_tolerance, render_mode, (width, height), layouts)
        self._executor: StepExecutor | None = None
        if dynamics == "mujoco":
            from mlivr_gym.simulation.setup import Setup
            from mlivr_gym.simulation.step_executor import StepExecutor

            setup = Setup.of(limits, controller, physics, disturbances)
            self._executor = StepExecutor(graph, setup)
        points = len(graph.grasp_map)
        self.reward.check_fits(points)
        self.failure_probability = failure_probabilities(points, grasp_failure, grasp_failure_seed)
        if layouts:
            self.table_moves()
        self._stream, self._seeded = Stream(0), False
        self.regret = EpisodeRegret(self) if info_regret else None

    @checked(ENV_ARGUMENTS)
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; the class describes the options. A goal alone takes a drawn start.

        Returned are the first observation and the information. Raises a `MlivrError` if the options
        cannot be used, no task is found, or no step leaves the start.
        """
        super().reset(seed=seed)
        if not self._seeded and seed is None:
            self._stream, self._seeded = Stream.of_seed(int(self.np_random.integers(2**63))), True
        stream = Stream(self._stream.state) if seed is None else Stream.of_seed(seed)
        graph, executor = self.graph, self._executor
        given = ResetOptions.of(options, graph, plans=executor is not None)
        start, goal = given.start_and_goal(graph, self.tasks, self.goal_tolerance)
        if start is None or goal is None:
            task = draw_task_with_tables(self.moves, self.tasks, stream, self.goal_tolerance, start)
            start, goal = start or task.start, task.goal if goal is None else goal
        if executor is not None:
            executor, start = self._begin_simulation(executor, Task(start, goal), given, stream)
            self._executor, self._simulation_info = executor, executor.measures
        if not self.moves.successors(start):
            raise StanceError(
                f"no step leaves the start stance {graph.ids(start.stance)}; choose another start"
            )
        self.goal, self._stream, self._seeded = goal, stream, True
        if isinstance(self.tasks, LayoutTasks):
            fewest = fewest_steps(self.table_moves(), start, goal, self.goal_tolerance)
            self._task_info = {"fewest_steps": fewest}
        self._enter_state(start)
        self.steps, self.base_translation = 0, 0.0
        if self.regret is not None:
            self._task_info = self._task_info | self.regret.start(self)
        self._record_event(
            "the start", None if executor is None else motion_at_rest(executor.configuration)
        )
        return self._observation(), self._info(False)

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move limb `action // m` to point `action % m`, if this action is valid.

        The action is an int, or an integer array or tensor without axes. Returned are observation,
        reward, terminated, truncated (always False here), and the information. Raises a
        `gymnasium.error.ResetNeeded` before the first reset and after a step that failed, and a
        `SettingError` if the action is not in the action space.
        """
        self._refresh()
        state, points = self.state, len(self.graph.grasp_map)
        if self._simulation_info.get("failure"):
            raise gymnasium.error.ResetNeeded(
                "the last step failed; call reset() to start another episode"
            )
        action = action_number(action, len(self._mask))
        valid, before, made = bool(self._mask[action]), self._distance, Attempt(state)
        self.steps += 1
        if valid:
            made = self._attempt(action)
            self._enter_state(made.after)
            self.base_translation += made.displacement
        success = self._distance <= self.goal_tolerance
        reward, moved = self.reward, divmod(action, points)
        outcome = StepOutcome(
            made.displacement, before, self._distance, success, valid, self.graph.max_displacement,
            state.stance_after(*moved) if valid and moved[0] < self.graph.limbs else state.stance,
            moved[1],
        )  # fmt: skip
        if made.reward is not None:
            reward = reward._replace(step_reward=made.reward)
        caption = made.caption or action_caption(self.graph, moved, valid, made.grasp_failed)
        self._record_event(caption, made.simulated)
        ended = success or made.is_end or bool(self._simulation_info.get("failure"))
        if self.regret is not None:
            cost = -float(self.reward.step_reward(outcome))
            self._task_info = self._task_info | self.regret.charge(self, cost)
        info = self._info(not valid, made.grasp_failed)
        return self._observation(), float(reward(outcome)), ended, False, info

    @property
    def is_simulated(self) -> bool:
        """Whether MuJoCo carries the steps out (`dynamics="mujoco"`)."""
        return self._executor is not None

    def _begin_simulation(
        self, executor: StepExecutor, task: Task, given: ResetOptions, stream: Stream
    ) -> tuple[StepExecutor, State]:
        """Put the simulated robot into the start; return its state, one branch for each limb.

        With it comes the executor of the episode.
        """
        return executor, executor.start(task.start, given.plan, executor.draw(stream))

    def _attempt(self, action: int) -> Attempt:
        """Make the step of a valid action, or attempt it."""
        state, executor = self.state, self._executor
        limb, point = divmod(action, len(self.graph.grasp_map))
        after, displacement = self._planned_step(action)
        if executor is None:
            if self._grasp_fails(point):
                back = state_after_failure(self.graph, state, after, limb)
                return Attempt(back, 2.0 * displacement, True)
            return Attempt(after, displacement)
        base = executor.configuration[0]
        after, executed = executor.step(limb, point, after.branch_sets)
        self._simulation_info = executor.measures
        if executor.measures["failure"]:
            displacement = float(np.linalg.norm(executor.configuration[0] - base))
        return Attempt(after, displacement, simulated=recorded_motion(executed))

    def _grasp_fails(self, point: int) -> bool:
        """Return whether an attempt to grasp a point fails."""
        risk = self.failure_probability[point]
        return bool(risk > 0.0 and self._stream.random() < risk)
