"""Start, goal and things of the walks with which the closed loop is tested."""

from mlivr_gym import Box
from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera

START, GOAL = ("D2a:4", "D2b:4"), (4.2, 0.0, 0.42)
CAMERA = DepthCamera(pixels=28, period=1.0)
BAG = Box.between("bag", "obstacle", (3.5, -0.35, -0.9), (3.8, 0.35, 0.0))


def kinds(record):
    """Kinds of the events of a walk, in order."""
    return [event.kind for event in record.events]
