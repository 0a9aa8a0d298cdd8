"""Take any valid action."""

import numpy as np

RANDOM = np.random.default_rng(0)


def act(observation, mask):
    """Return a valid action, or the first one if none is."""
    actions = np.flatnonzero(mask)
    return int(RANDOM.choice(actions)) if len(actions) else 0
