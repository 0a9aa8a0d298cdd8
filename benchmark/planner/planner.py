"""Follow plans of the package's planner, made anew when something is not as expected."""

from mlivr_gym.agents import planner_policy
from mlivr_gym.extensions.closed_loop import LookingPolicy, UnknownMapEnv


class Planned:
    """Plans with its default settings; where the map is unknown it looks before it grasps."""

    def __init__(self):
        self.steps = planner_policy("steps")
        self.looking = LookingPolicy(self.steps)

    def act(self, env, observation, mask):
        """Return the next action of the plan."""
        chosen = self.looking if isinstance(env, UnknownMapEnv) else self.steps
        return chosen.act(env, observation, mask)
