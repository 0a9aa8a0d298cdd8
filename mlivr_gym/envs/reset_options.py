"""The options of `MlivrEnv.reset`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mlivr_gym.arguments import Of
from mlivr_gym.envs.tasks import FIXED_NUMBER
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.schema import Anything, Fields, Maybe
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State
from mlivr_gym.world.grasp_map import GOAL, STANCE

OPTIONS = Fields(
    {},
    {
        "start": Maybe(STANCE),
        "start_pose": Anything(),
        "start_joints": Anything(),
        "goal": Maybe(GOAL),
        "task": Maybe(FIXED_NUMBER),
        "plan": Maybe(Of(Plan)),
    },
)
"""The options; a pose and joint angles are read by the stance graph."""


@dataclass(frozen=True)
class ResetOptions:
    """Where to start and where to go; what is None is drawn.

    Attributes
    ----------
    start
        Point id or index that each limb holds, N of them.
    start_pose
        Base pose at the start [m], x, y, z and quaternion w, x, y, z.
    start_joints
        Joint angles at the start, shape (N, 6) [rad].
    goal
        Goal position of the base, shape (3,) [m].
    plan
        A plan to follow from its start.
    task
        Number of a fixed task, which tells start and goal.
    """

    start: Any = None
    start_pose: Any = None
    start_joints: Any = None
    goal: Any = None
    plan: Plan | None = None
    task: Any = None

    @classmethod
    def of(
        cls, options: Mapping[str, Any] | None, graph: StanceGraph, *, plans: bool
    ) -> ResetOptions:
        """Check the options and take start and goal from the plan where they are not given.

        Parameters
        ----------
        options
            What `OPTIONS` reads.
        graph
            The stance graph.
        plans
            Whether `"plan"` is an option.

        Raises
        ------
        SettingError
            If options do not go together.
        """
        given = dict(options or {})
        if "plan" in given and not plans:
            raise SettingError("reset option 'plan' needs dynamics='mujoco'")
        if given.get("task") is not None and len(given) > 1:
            raise SettingError("reset option 'task' tells start and goal: give it alone")
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

    def state(self, graph: StanceGraph) -> State | None:
        """The start, if one is given.

        Raises
        ------
        MlivrError
            If the robot cannot start there; the message names the option.
        """
        if self.start is None:
            return None
        return graph.state(self.start, self.start_pose, self.start_joints)
