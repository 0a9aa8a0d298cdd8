"""The policy that ships, which imitation taught two limbs on the known map."""

from mlivr_gym.agents import load_policy
from mlivr_gym.extensions.closed_loop import LookingPolicy, UnknownMapEnv


class Pretrained:
    """Acts as it learned in `MLIVR-JEM-v0`; in the unknown map it looks before grasps."""

    environment_steps = 2 * 6 * 9 * 12 * 40 * 20
    """States of its rollouts at most, each of which counts as a step and as a label."""

    def __init__(self):
        self.policy = None

    def act(self, env, observation, mask):
        """Return the most probable action that leads to a stance not held before."""
        if self.policy is None:
            self.policy = load_policy("pretrained", env)
        if isinstance(env, UnknownMapEnv):
            return LookingPolicy(self.policy).act(env, observation, mask)
        steps = env.graph.limbs * len(env.graph.grasp_map)
        return self.policy.act(env, observation, mask[:steps])
