"""Options of `MlivrEnv.reset`: start, goal, fixed task or plan of the episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from mlivr_gym.arguments import InstanceOf
from mlivr_gym.arrays import Array
from mlivr_gym.envs.layout_tasks import LayoutTasks
from mlivr_gym.envs.task import TaskGenerator
from mlivr_gym.envs.tasks import FIXED_NUMBER, fixed_task
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.schema import Anything, OrNone, Struct
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.given_points import GOAL, STANCE


@dataclass(frozen=True)
class ResetOptions:
    """Start and goal of an episode as the caller gives them; what is None is drawn."""

    start: Annotated[Any, OrNone(STANCE)] = None
    """Point that each limb holds, N ids or indices."""
    start_pose: Annotated[Any, Anything()] = None
    """Base pose at the start: x, y, z [m] and quaternion w, x, y, z."""
    start_joints: Annotated[Any, Anything()] = None
    """Joint angles at the start, shape (N, 6) [rad]."""
    goal: Annotated[Any, OrNone(GOAL)] = None
    """Goal position of the base, shape (3,) [m]."""
    plan: Annotated[Plan | None, OrNone(InstanceOf(Plan))] = None
    """A plan, from whose start the episode starts."""
    task: Annotated[Any, OrNone(FIXED_NUMBER)] = None
    """Number of a fixed task, which has both start and goal."""

    @classmethod
    def of(
        cls, options: Mapping[str, Any] | None, graph: StanceGraph, *, plans: bool
    ) -> ResetOptions:
        """Return the options, which `RESET_OPTIONS` has checked, with start and goal from the plan.

        Start and goal that are given are kept. `plans` is whether the option `"plan"` is valid.
        Raises a `SettingError` if options contradict each other.
        """
        given = dict(options or {})
        if "plan" in given and not plans:
            raise SettingError("reset option 'plan' needs dynamics='mujoco'")
        if given.get("task") is not None and len(given) > 1:
            raise SettingError("reset option 'task' includes start and goal; give it alone")
        plan = given.get("plan")
        if plan is not None:
            motion, start = plan.motion, plan.stances[0]
            pose = graph.given_pose_of(start, motion.base_positions[0], motion.base_quaternions[0])
            given = {"start": start, "start_pose": pose, "goal": plan.query.goal, **given}
        made = cls(**given)
        if made.start is None and not (made.start_pose is None and made.start_joints is None):
            raise SettingError(
                "reset options 'start_pose' and 'start_joints' need 'start', the stance they "
                "belong to"
            )
        return made

    def start_and_goal(
        self, graph: StanceGraph, tasks: TaskGenerator, tolerance: float
    ) -> tuple[State | None, Array | None]:
        """Return start and goal [m], each None unless an option gives it.

        Raises a `MlivrError` if the robot cannot start there, the goal lies outside the cabin, or
        the fixed task cannot be drawn.
        """
        start, goal = None, self.goal
        if self.start is not None:
            # The layout that is drawn leaves the points of a start free, whatever the last one did.
            is_drawn = goal is None and isinstance(tasks, LayoutTasks)
            last = sorted(graph.occupied) if is_drawn else []
            graph.vacate(last)
            try:
                start = graph.state(self.start, self.start_pose, self.start_joints)
            finally:
                graph.occupy(last)
        if self.task is not None:
            start, goal = fixed_task(tasks, graph, self.task, tolerance)
        return start, None if goal is None else graph.grasp_map.check_goal(goal)


RESET_OPTIONS = Struct.of(ResetOptions).fields
"""Validator of each option; the stance graph checks a start pose and joint angles."""
