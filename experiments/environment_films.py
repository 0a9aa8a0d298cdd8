"""Film one episode of each environment, in which A* takes the fewest steps.

    python experiments/environment_films.py [--out results]

The frames are those that `render` returns with `render_mode="rgb_array_list"`. Writes `env_jem.gif`
and `env_far.gif`.
"""

from __future__ import annotations

import gymnasium
from reports import command_line

from mlivr_gym.agents import evaluate, planner_policy
from mlivr_gym.envs import MlivrEnv
from mlivr_gym.pictures import save_film

EPISODES = {"env_jem": ("MLIVR-JEM-v0", 4), "env_far": ("MLIVR-JEM-Far-v0", 1)}
"""Environment and seed of each film."""

SIZE = {"width": 448, "height": 252}
"""Size of the frames [px]."""


def main() -> None:
    """Run the episodes and write their films."""
    out = command_line(__doc__).parse_args().out
    for name, (identity, seed) in EPISODES.items():
        env = gymnasium.make(identity, render_mode="rgb_array_list", **SIZE).unwrapped
        assert isinstance(env, MlivrEnv)
        result = evaluate(env, planner_policy("steps"), 1, seed)
        save_film(env.render(), out / f"{name}.gif")
        print(f"{name}: {result.steps[0]} steps, {result.base_translation[0]:.2f} m")
        env.close()


if __name__ == "__main__":
    main()
