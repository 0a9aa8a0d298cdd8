"""Film Case 3 at two paces side by side, and one episode of each of two environments.

    python experiments/films.py [--out results]

`pace.gif` has Case 3 at the paper's pace and at the fastest pace that the limits allow: both halves
of a frame show the same time after the start, faster than real time by a factor that is stated. In
`env_jem.gif` and `env_far.gif` A* takes the fewest steps; the frames are those that `render`
returns with `render_mode="rgb_array_list"`.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
from reports import case_3, command_line

from mlivr_gym.agents import evaluate, planner_policy
from mlivr_gym.envs import MlivrEnv
from mlivr_gym.motion import Durations
from mlivr_gym.pictures import film_pictures, save_film, with_caption
from mlivr_gym.pictures.films import default_speed, film_samples, recording_shots
from mlivr_gym.simulation import Limits, Setup, execute
from mlivr_gym.simulation.parameters import CONTROLLERS

HALF = (400, 225)
"""Size of each half of a frame of the paces [px]."""

PACES = {
    "the paper's 10, 30 and 10 s": Setup(Durations(), CONTROLLERS["feedforward"]),
    "as fast as the limits allow": Setup(Limits()),
}
"""The two executions that are compared."""

EPISODES = {"env_jem": ("MLIVR-JEM-v0", 4), "env_far": ("MLIVR-JEM-Far-v0", 1)}
"""Environment and seed of each film of an episode."""

SIZE = {"width": 448, "height": 252}
"""Size of the frames of episodes [px]."""


def film_paces(path: Path) -> None:
    """Simulate the walk twice and write the film."""
    (graph, plan), recordings = case_3(), []
    for setup in PACES.values():
        simulation = setup.simulation(graph.grasp_map, graph.robot, graph.obstacles)
        execution = execute(graph, plan, setup.timing, simulation=simulation)
        assert execution.failure is None
        recordings.append(execution.recording)
    longest = max(recordings, key=lambda recording: float(recording.times[-1]))
    speed, sides = default_speed(longest), []
    times = longest.times[film_samples(longest, speed)]
    for words, recording in zip(PACES, recordings, strict=True):
        samples = np.searchsorted(recording.times, times - 1e-9).clip(0, len(recording.times) - 1)
        shown = recording_shots(graph.grasp_map, recording, samples, plan, speed)
        pictures = film_pictures(graph.grasp_map, graph.robot, shown, HALF)
        # A caption of one line goes above each picture.
        sides.append(
            [np.vstack([with_caption(one[:1], words, HALF[1])[1:], one]) for one in pictures]
        )
    save_film([np.hstack(pair) for pair in zip(*sides, strict=True)], path)


def main() -> None:
    """Write all films."""
    out = command_line(__doc__).parse_args().out
    film_paces(out / "pace.gif")
    for name, (identity, seed) in EPISODES.items():
        env = gymnasium.make(identity, render_mode="rgb_array_list", **SIZE).unwrapped
        assert isinstance(env, MlivrEnv)
        result = evaluate(env, planner_policy("steps"), 1, seed)
        save_film(env.render(), out / f"{name}.gif")
        print(f"{name}: {result.steps[0]} steps, {result.base_translation[0]:.2f} m")
        env.close()


if __name__ == "__main__":
    main()
