"""Work that tests give to other processes, which cannot import test modules by their names."""

import time

from mlivr_gym.stances.workers import tell

PARTS = 200


def slow(worker):
    """Takes 20 s unless it is stopped."""
    for k in range(PARTS):
        time.sleep(0.1)
        tell(worker, (k + 1) / PARTS)
    return worker


def quick(worker, add):
    tell(worker, 0.5)
    return worker + add
