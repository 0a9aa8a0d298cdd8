"""The environment of the closed loop: simulated steps among things that the map lacks; a policy."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mlivr_gym.arguments import InstanceOf, Reader, checked
from mlivr_gym.arrays import BoolArray
from mlivr_gym.envs import (
    TASKS,
    Attempt,
    LayoutTasks,
    MlivrEnv,
    Observation,
    ResetOptions,
    Task,
    TaskGenerator,
)
from mlivr_gym.envs.snapshots import motion_of
from mlivr_gym.envs.streams import Stream
from mlivr_gym.envs.tasks import FIRST_FIXED_SEED
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.extensions.closed_loop.belief import Belief
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
from mlivr_gym.extensions.closed_loop.record import ClosedLoopRecord
from mlivr_gym.extensions.closed_loop.sensing_robot import SensingRobot
from mlivr_gym.extensions.closed_loop.things import BOXES, PLATES, unknown_things
from mlivr_gym.planners import QUERY, Cost, Plan, Planner
from mlivr_gym.schema import Integer
from mlivr_gym.sharing import Independent
from mlivr_gym.simulation import Recording, StepExecutor
from mlivr_gym.stances import State
from mlivr_gym.values import MAX_PARTS
from mlivr_gym.world import Box

DRAWS = 10
"""Number of times that things are drawn until a plan that knows them exists."""


CAMERA = Reader(lambda given, _: None if given is None else DepthCamera.of(given))
"""Validator of depth cameras, which are given as themselves or as plain data; None for none."""


class ClosedLoopEnv(MlivrEnv):
    """Climbing among things that are seen on the way only: the closed loop as an environment.

    Each episode has unknown things of its own, see `unknown_things`: boxes in the cabin, and plates
    that cover points. With two limbs they are drawn anew, at most `DRAWS` times, until a plan
    exists that knows them, and the limbs start on the branches of that plan. Robot, cameras,
    sensing and going back are those of `mlivr-gym walk`; in place of its planner an agent chooses
    the steps. Dynamics are `"mujoco"`.

    * Actions `limb * m + point` are as in `MlivrEnv`, and valid if the step is free of what was
      seen. The cameras look during the step and after it. If something new lies in its path, or
      the grasp is refused or missed, the limb goes back, and the episode goes on. The second such
      attempt makes the point count as occupied.
    * The last action, `N m`, relaxes (`Belief.relax`), and is valid in every state: the robot takes
      what it saw to be a little smaller, once. If it cannot relax any more, it stops, holding all
      its points, and the episode ends without success.

    `graph` has what the robot knows, so planners and policies that use it plan in the world that
    the robot believes in. A plan also chooses the branches of the limbs, see `follow`, as
    `ReplanningPolicy` does.

    The observation has in addition `occupied`, the points that count as occupied, and `obstacles`,
    the cells of the module in which surfaces were seen that the map lacks. `info` has
    `path_blocked`, whether the last step was given up, or not begun, for something in its path;
    `grasp_failed`, whether the grasp was refused or missed; `is_stopped`; and with two limbs
    `fewest_steps`, those of an optimal plan that knows the things, -1 if there is none. An attempt
    that failed counts as a step, and its displacement is the length of the base's path.

    Attributes
    ----------
    camera
        The depth cameras; None if the robot is blind.
    boxes, plates
        Number of unknown things.
    things
        The things of the present episode, which policies must not use.
    """

    further_actions = 1

    @checked(
        {
            "boxes": Integer(0, MAX_PARTS),
            "plates": Integer(0, MAX_PARTS),
            "camera": CAMERA,
            "tasks": TASKS,
        }
    )
    def __init__(
        self,
        boxes: int = BOXES,
        plates: int = PLATES,
        camera: DepthCamera | dict[str, Any] | None = DepthCamera(),  # noqa: B008, it is frozen
        tasks: str | TaskGenerator | dict[str, Any] = "walk",
        **options: Any,
    ) -> None:
        """Build the environment; `tasks` and `options` are arguments of `MlivrEnv`.

        Raises a `MlivrError` if an argument cannot be used: tasks cannot have layouts.
        """
        if options.setdefault("dynamics", "mujoco") != "mujoco":
            raise SettingError(
                f"dynamics is {options['dynamics']!r}; this environment needs 'mujoco'"
            )
        super().__init__(tasks=tasks, **options)
        if not self.graph.settings.collisions:
            raise SettingError("collisions is False; among unknown things it must be True")
        if isinstance(self.tasks, LayoutTasks):
            raise SettingError(
                f"tasks is {shortened(tasks)}, which draws layouts; this environment draws unknown "
                "things instead: give 'walk', 'far' or another TaskGenerator"
            )
        assert not isinstance(camera, dict)  # it was read
        self.camera, self.boxes, self.plates = camera, boxes, plates
        self.things: tuple[Box, ...] = ()
        self._robot: SensingRobot | None = None
        self._is_stopped = self._layouts = True
        points, known = len(self.graph.grasp_map), self.observation_space
        assert isinstance(known, spaces.Dict)
        cells = Belief(self.graph, 0.0).occupancy().shape
        self.observation_space = spaces.Dict(
            known.spaces
            | {"occupied": spaces.MultiBinary(points), "obstacles": spaces.MultiBinary(cells)}
        )

    @property
    def record(self) -> ClosedLoopRecord:
        """What happened in the episode so far, as in a walk of the closed loop.

        It has the events and the largest force, and after a failure its reason; fields that are set
        at the end of a walk have their defaults. Raises a `gymnasium.error.ResetNeeded` before the
        first reset.
        """
        return self._sensing.record

    @property
    def _sensing(self) -> SensingRobot:
        """The robot of the episode."""
        if self._robot is None:
            raise gymnasium.error.ResetNeeded("there is no episode yet; call reset() first")
        return self._robot

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode, see `MlivrEnv.reset`; the robot looks round from its start.

        The things are drawn for each episode; those of a fixed task are the same in every process.
        Obstacles that have been added to `graph` are known. If the reset fails, there is no
        episode.
        """
        self._forget()
        super().reset(seed=seed, options=options)
        self._is_stopped = False
        self._sensing.look_round()
        self._refresh()
        return self._observation(), self._info(False)

    def _forget(self) -> None:
        """Take what was sensed in an episode out of the graph again."""
        if self._robot is not None:
            belief, self._robot, self._state = self._robot.belief, None, None
            belief.withdraw()

    def _begin_simulation(
        self, executor: StepExecutor, task: Task, given: ResetOptions, stream: Stream
    ) -> tuple[StepExecutor, State]:
        """Draw the unknown things, and put the simulated robot among them."""
        seed, drawn = 1 + stream.integers(2**31), stream.integers(2**53)
        drawn = drawn if given.task is None else FIRST_FIXED_SEED + given.task
        rng = np.random.default_rng([drawn, 1])
        for _ in range(DRAWS):
            self.things = unknown_things(self.graph, task.start, rng, self.boxes, self.plates)
            plan = self._plan_that_knows_them(task)
            if plan is not None or not self.graph.lists_all:
                break
        if self.graph.lists_all:
            self._task_info = {"fewest_steps": -1 if plan is None else len(plan.steps)}
        obstacles = (*self.graph.obstacles, *self.things)
        executor = StepExecutor(self.graph, executor.setup, obstacles)
        robot = SensingRobot(executor, self.camera, seed)
        plan = given.plan or plan
        state = robot.start(task.start, plan if plan and plan.steps else None, frozenset())
        executor.follow(given.plan)
        self._robot = robot
        return executor, state

    def _plan_that_knows_them(self, task: Task) -> Plan | None:
        """Return an optimal plan among the things; None if there is none, or for more limbs."""
        if not self.graph.lists_all:
            return None
        planner, goal, tolerance = Planner(self.graph), task.goal.tolist(), self.goal_tolerance
        self.graph.add_obstacles(self.things)
        try:
            return planner.plan(task.start, goal, "steps", goal_tolerance=tolerance).plan
        finally:
            self.graph.remove_obstacles([thing.id for thing in self.things])

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Attempt a step, or relax; see `MlivrEnv.step`.

        Raises a `gymnasium.error.ResetNeeded` before the first reset, and after the end of the
        episode by a failure or a stop.
        """
        robot = self._sensing
        if self._is_stopped:
            raise gymnasium.error.ResetNeeded("the robot has stopped; call reset()")
        robot.refused = None
        return super().step(action)

    @checked({"plan": InstanceOf(Plan)})
    def follow(self, plan: Plan) -> None:
        """Put the limbs on the branches of a plan from the present state, if actions follow it.

        Otherwise a limb that grasps is put on the branch from which most steps are valid.
        """
        self._sensing.executor.follow(plan)

    def _attempt(self, action: int) -> Attempt:
        """Relax, or attempt a step, and look round where it has led."""
        robot = self._sensing
        if action == self.graph.limbs * len(self.graph.grasp_map):
            self._is_stopped = not robot.belief.relax()
            robot.belief.update_graph(self.state)
            caption = "stops" if self._is_stopped else "relaxes"
            return Attempt(self.state, caption=caption, is_end=self._is_stopped)
        limb, point = divmod(action, len(self.graph.grasp_map))
        after, displacement = self._planned_step(action)
        is_done = robot.attempt(limb, point, after.branch_sets)
        self._simulation_info = robot.executor.measures
        if not is_done:
            paths = [np.diff(one.recording.base_positions, axis=0) for one in robot.intervals]
            displacement = sum(float(np.linalg.norm(path, axis=1).sum()) for path in paths)
            if not robot.record.reason:
                self._simulation_info = self._simulation_info | {"failure": None}
        robot.look_round()
        recordings = [one.recording for one in robot.intervals]
        motion = motion_of(Recording.join(recordings)) if recordings else None
        return Attempt(robot.executor.state, displacement, robot.refused == "refused", motion)

    def _observation(self) -> Observation:
        """Return the observation of the present state, with what was sensed."""
        seen = super()._observation()
        seen["obstacles"] = self._sensing.belief.occupancy().astype(np.int8)
        return seen

    def _info(self, invalid: bool, failed: bool = False) -> dict[str, Any]:
        """Return the information on the present state and the last action."""
        blocked = self._robot is not None and self._robot.refused == "blocked"
        told = {"path_blocked": blocked, "is_stopped": self._is_stopped}
        return {**super()._info(invalid, failed), **told}


class ReplanningPolicy(Independent):
    """Policy for `ClosedLoopEnv` that plans before each action in the world that is believed.

    It takes the first step of the plan, and relaxes if there is no plan, or none of its steps left.
    """

    @checked(QUERY)
    def __init__(self, cost: str | Cost = "steps", **options: Any) -> None:
        """Plan with a cost, and further arguments of `Planner.plan`."""
        self._cost, self._options = cost, options
        self._planner: Planner | None = None

    @checked({"env": InstanceOf(ClosedLoopEnv)})
    def act(self, env: MlivrEnv, observation: Observation, mask: BoolArray) -> int:
        """Return the action to take; see `Policy.act`.

        Raises a `SettingError` if the environment is not a `ClosedLoopEnv`.
        """
        assert isinstance(env, ClosedLoopEnv)
        if self._planner is None or self._planner.graph is not env.graph:
            self._planner = Planner(env.graph)
        goal, tolerance = env.goal.tolist(), env.goal_tolerance
        plan = self._planner.plan(
            env.state, goal, self._cost, goal_tolerance=tolerance, **self._options
        ).plan
        if plan is None or not plan.steps:
            return len(mask) - 1
        env.follow(plan)
        limb, point = plan.actions[0]
        return limb * len(env.graph.grasp_map) + env.graph.grasp_map.index(point)
