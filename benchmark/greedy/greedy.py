"""Take the step that brings the middle of the points held closest to the goal."""

import numpy as np

from mlivr_gym import jem_map

JEM = jem_map().positions


def act(observation, mask):
    """Return a valid action, from the observation and the mask of valid actions alone."""
    points = JEM
    if "points" in observation:  # in an unseen place
        points = observation["points"].reshape(-1, 3)[observation["exists"] > 0]
    held = observation["grasps"].reshape(-1, 3)
    steps = np.flatnonzero(mask[: len(held) * len(points)])
    if not len(steps):
        return len(mask) - 1  # a look, in the unknown map
    limb, point = np.divmod(steps, len(points))
    middle = (held.sum(axis=0) - held[limb] + points[point]) / len(held)
    away = np.linalg.norm(middle - observation["goal"], axis=1)
    return int(steps[away.argmin()])
