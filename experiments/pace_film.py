"""Film Case 3 at the paper's pace and at the fastest pace that the limits allow, side by side.

    python experiments/pace_film.py [--out results]

Both halves of a frame show the same time after the start. The film runs faster than real time and
states the factor. Writes `pace.gif`.
"""

from __future__ import annotations

import numpy as np
from reports import case_3, command_line

from mlivr_gym.motion import Durations
from mlivr_gym.pictures import film_pictures, save_film, with_caption
from mlivr_gym.pictures.films import default_speed, film_samples, recording_shots
from mlivr_gym.simulation import Limits, Setup, execute
from mlivr_gym.simulation.parameters import CONTROLLERS

SIZE = (400, 225)
"""Size of each half of a frame [px]."""

PACES = {
    "the paper's 10, 30 and 10 s": Setup(Durations(), CONTROLLERS["feedforward"]),
    "as fast as the limits allow": Setup(Limits()),
}
"""The two executions that are compared."""


def main() -> None:
    """Simulate the walk twice and write `pace.gif`."""
    out = command_line(__doc__).parse_args().out
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
        pictures = film_pictures(graph.grasp_map, graph.robot, shown, SIZE)
        # A caption of one line goes above each picture.
        sides.append(
            [np.vstack([with_caption(one[:1], words, SIZE[1])[1:], one]) for one in pictures]
        )
    frames = [np.hstack(pair) for pair in zip(*sides, strict=True)]
    save_film(frames, out / "pace.gif")


if __name__ == "__main__":
    main()
