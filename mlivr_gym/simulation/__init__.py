"""Plans carried out in MuJoCo: scene, robot, controller, execution, disturbances, record.

`execute` carries a plan out; a `Setup` chooses pace, controller, physics and disturbances.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.simulation.disturbances import DisturbanceRanges
    from mlivr_gym.simulation.execution import Execution, execute
    from mlivr_gym.simulation.export import exported_model
    from mlivr_gym.simulation.parameters import PACES, Limits, Physics
    from mlivr_gym.simulation.recording import Recording
    from mlivr_gym.simulation.scene import compile_spec, scene_spec, set_configuration
    from mlivr_gym.simulation.setup import Setup
    from mlivr_gym.simulation.simulator import Simulation
    from mlivr_gym.simulation.step_executor import StepExecutor
    from mlivr_gym.simulation.timing import plan_trajectory

__all__ = [
    "PACES",
    "DisturbanceRanges",
    "Execution",
    "Limits",
    "Physics",
    "Recording",
    "Setup",
    "Simulation",
    "StepExecutor",
    "compile_spec",
    "execute",
    "exported_model",
    "plan_trajectory",
    "scene_spec",
    "set_configuration",
]

__getattr__, __dir__ = lazy(__name__)
