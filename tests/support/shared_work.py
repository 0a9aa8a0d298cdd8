"""Work that tests give to other processes, which cannot import test modules by their names."""

import time

from mlivr_gym.stances.workers import report_share

PARTS = 200


def slow(worker):
    """Takes 20 s unless it is stopped."""
    for k in range(PARTS):
        time.sleep(0.1)
        report_share(worker, (k + 1) / PARTS)
    return worker


def quick(worker, add):
    report_share(worker, 0.5)
    return worker + add
