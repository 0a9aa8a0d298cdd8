"""Planning and learning for multi-limbed robots that climb hand over hand inside space stations.

Importing the package registers its Gymnasium environments: `MLIVR-JEM-v0`, `MLIVR-JEM-Far-v0`,
`MLIVR-Random-v0`, `MLIVR-JEM-Cargo-v0`, `MLIVR3-JEM-v0`, `MLIVR4-JEM-v0`,
`MLIVR4-JEM-Anywhere-v0`, `MLIVR-USLab-v0`, `MLIVR-Columbus-v0`, `MLIVR-Hatch-v0`,
`MLIVR-Station-v0`, `MLIVR-Truss-v0`, and those of the extensions.
"""

import mlivr_gym._interrupts  # before what takes time

# isort: split
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register

import mlivr_gym._headless  # noqa: F401
from mlivr_gym._version import __version__
from mlivr_gym.extensions import environments
from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.errors import MlivrError
    from mlivr_gym.planners.planner import Planner
    from mlivr_gym.robot.capsules import Capsule
    from mlivr_gym.robot.limb import Limb
    from mlivr_gym.robot.specification import RobotSpec, robot_spec
    from mlivr_gym.settings import Settings
    from mlivr_gym.simulation.execution import execute
    from mlivr_gym.stances.build import stance_graph
    from mlivr_gym.transitions.state import State
    from mlivr_gym.world.boxes import Box
    from mlivr_gym.world.grasp_map import GraspMap, jem_map

__all__ = [
    "Box",
    "Capsule",
    "GraspMap",
    "Limb",
    "MlivrError",
    "Planner",
    "RobotSpec",
    "Settings",
    "State",
    "__version__",
    "execute",
    "jem_map",
    "robot_spec",
    "stance_graph",
]

__getattr__, __dir__ = lazy(__name__)

_ARGUMENTS: dict[str, dict[str, Any]] = {
    "MLIVR-JEM-v0": {},
    "MLIVR-JEM-Far-v0": {"tasks": "far"},
    "MLIVR-JEM-Cargo-v0": {"tasks": "far", "cargo": {"mass": 30.0, "size": [0.4, 0.4, 0.3]}},
    "MLIVR-Random-v0": {"tasks": "random"},
    "MLIVR3-JEM-v0": {"robot": "mlivr3"},
    "MLIVR4-JEM-v0": {"robot": "mlivr4"},
    "MLIVR4-JEM-Anywhere-v0": {"robot": "mlivr4", "tasks": "anywhere"},
    **{f"MLIVR-{_name}-v0": {"map": _name.lower()}
       for _name in ("USLab", "Columbus", "Hatch", "Station")},
    "MLIVR-Truss-v0": {
        "map": "truss", "robot": "ssrms2", "clearance": 0.1, "goal_tolerance": 2.0,
        **dict.fromkeys(("limits", "controller", "physics"), "station"),
    },
}  # fmt: skip
"""Arguments of `MlivrEnv` by the name of an environment."""

for _id, _given in _ARGUMENTS.items():
    # What draws a map for each episode, or has more than two limbs, has no vector environment.
    _has_vector = not _given.get("robot", "").startswith("mlivr") and "Random" not in _id
    register(
        id=_id,
        entry_point="mlivr_gym.envs.env:MlivrEnv",
        vector_entry_point="mlivr_gym.envs.vectors:vector_env" if _has_vector else None,
        max_episode_steps=100,
        kwargs=_given,
    )
for _name, _arguments in environments().items():
    register(id=_name, **_arguments)
