"""MaskablePPO of sb3-contrib in 64 copies of an environment of two limbs on the known map."""

import gymnasium
import torch
from sb3_contrib import MaskablePPO

from mlivr_gym.agents.sb3_env import TableVecEnv
from mlivr_gym.extensions.benchmark.protocol import MAX_ACTIONS

COPIES, STEPS = 64, 128
"""Number of copies, and of steps in each of them between two updates."""


def approach(outcome):
    """Return a reward for getting closer to the goal and for reaching it, less one for the step."""
    nearer = outcome.distance_before - outcome.distance_after
    return 3.0 * nearer + 3.0 * outcome.success - 0.3


class MaskedPPO:
    """Learns by trial and error until no further update fits into the budget."""

    def train(self, env, seed):
        """Learn in copies of its own, whose reward leads to the goal."""
        torch.set_num_threads(1)
        torch.distributions.Distribution.set_default_validate_args(False)  # a quarter of the time
        name = f"mlivr_gym:{env.unwrapped.spec.id}"
        own = gymnasium.make(name, reward=approach, disable_env_checker=True).unwrapped
        self.model = MaskablePPO(
            "MultiInputPolicy",
            TableVecEnv(own, COPIES, "plain", MAX_ACTIONS),
            learning_rate=lambda left: 1e-3 * left,
            n_steps=STEPS,
            batch_size=2048,
            n_epochs=4,
            gamma=0.95,
            ent_coef=0.005,
            policy_kwargs={"net_arch": [256, 256]},
            seed=seed,
            device="cpu",
        )
        update = COPIES * STEPS
        self.model.learn(env.budget // update * update)
        self.environment_steps = self.model.num_timesteps

    def act(self, env, observation, mask):
        """Return an action drawn from the policy."""
        return int(self.model.predict(observation, action_masks=mask)[0])
