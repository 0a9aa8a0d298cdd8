"""Film one episode of each environment, in which A* takes the fewest steps.

    python experiments/environment_films.py [--out results]

The frames are those that `render` returns with `render_mode="rgb_array_list"`. Writes `env_jem.gif`
and `env_far.gif`.
"""

from __future__ import annotations

import gymnasium
from reports import command_line

from mlivr_gym.agents import planner_policy
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.pictures.film import save_film

EPISODES = {"env_jem": ("MLIVR-JEM-v0", 4), "env_far": ("MLIVR-JEM-Far-v0", 1)}
"""Environment and seed of each film."""

SIZE = {"width": 448, "height": 252}
"""Size of the frames [px]."""


def main() -> None:
    """Run the episodes and write their films."""
    out = command_line(__doc__).parse_args().out
    for name, (identity, seed) in EPISODES.items():
        env = gymnasium.make(identity, render_mode="rgb_array_list", **SIZE)
        plain, policy, ended = env.unwrapped, planner_policy("steps"), False
        assert isinstance(plain, MlivrEnv)
        observation, _ = env.reset(seed=seed)
        while not ended:
            action = policy.act(plain, observation, plain.action_masks())
            observation, _, terminated, truncated, info = env.step(action)
            ended = terminated or truncated
        save_film(plain.render(), out / f"{name}.gif")
        print(f"{name}: {info['steps']} steps, {info['base_translation']:.2f} m")
        env.close()


if __name__ == "__main__":
    main()
