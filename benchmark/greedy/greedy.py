"""Take the step that brings the middle of both points closest to the goal."""

import numpy as np

from mlivr_gym import jem_map

POINTS = jem_map().positions


def act(observation, mask):
    """Return a valid action, from the observation and the mask of valid actions alone."""
    actions = np.flatnonzero(mask)
    if not len(actions):
        return 0
    limb, point = np.divmod(actions, len(POINTS))
    held = observation["grasps"].reshape(2, 3)
    middle = (held[1 - limb] + POINTS[point]) / 2
    away = np.linalg.norm(middle - observation["goal"], axis=1)
    return int(actions[away.argmin()])
