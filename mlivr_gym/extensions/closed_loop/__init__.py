"""The closed loop: a robot that senses what its map lacks, turns back and replans.

It sees boxes with depth cameras and notices refused grasps; what it believes are boxes around what
it saw. Its environments are a module with unknown boxes, and a map with unknown points.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.extensions.closed_loop.belief import Belief
    from mlivr_gym.extensions.closed_loop.depth_camera import DepthCamera
    from mlivr_gym.extensions.closed_loop.env import ClosedLoopEnv, ReplanningPolicy
    from mlivr_gym.extensions.closed_loop.film import closed_loop_film
    from mlivr_gym.extensions.closed_loop.loop import EFFORT, run_closed_loop
    from mlivr_gym.extensions.closed_loop.record import ARRIVED, STOPPED, ClosedLoopRecord
    from mlivr_gym.extensions.closed_loop.things import BOXES, PLATES, unknown_things
    from mlivr_gym.extensions.closed_loop.unknown_map import LookingPolicy, UnknownMapEnv

__all__ = [
    "ARRIVED",
    "BOXES",
    "EFFORT",
    "PLATES",
    "STOPPED",
    "Belief",
    "ClosedLoopEnv",
    "ClosedLoopRecord",
    "DepthCamera",
    "LookingPolicy",
    "ReplanningPolicy",
    "UnknownMapEnv",
    "closed_loop_film",
    "run_closed_loop",
    "unknown_things",
]

COMMANDS = {
    "walk": (
        "walk through a partly unknown module, sensing and replanning",
        "mlivr-gym walk --unknown 3.2 -1.0 -1.0 3.5 1.0 0.3 --picture walk.png",
        "mlivr-gym walk --refusing A4a:4 --disturbances all --out walk.json",
    ),
}

ENVIRONMENTS = {
    "MLIVR-JEM-Unknown-v0": {
        "entry_point": "mlivr_gym.extensions.closed_loop.unknown_map:UnknownMapEnv",
        "max_episode_steps": 100,
    },
    "MLIVR-JEM-ClosedLoop-v0": {
        "entry_point": "mlivr_gym.extensions.closed_loop.env:ClosedLoopEnv",
        "max_episode_steps": 100,
        "kwargs": {"success_bonus": 100.0},
    },
}

__getattr__, __dir__ = lazy(__name__)
