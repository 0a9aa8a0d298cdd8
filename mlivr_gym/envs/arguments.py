"""Validators of the arguments of the environments, by which they are checked."""

from __future__ import annotations

import numpy as np
from gymnasium.vector import AutoresetMode

from mlivr_gym.arguments import ANY_NUMBER, NOT_NEGATIVE, SEED, Reader, Validators, WithError
from mlivr_gym.envs.dynamics import DYNAMICS, simulation_part
from mlivr_gym.envs.grasp_failure import GRASP_FAILURE
from mlivr_gym.envs.reset_options import RESET_OPTIONS
from mlivr_gym.envs.rewards import REWARD
from mlivr_gym.envs.tasks import TASKS
from mlivr_gym.envs.viewer import RENDER_FPS
from mlivr_gym.errors import RobotError
from mlivr_gym.pictures.rendering import HEIGHT, WIDTH
from mlivr_gym.robot.cargo import CARGO
from mlivr_gym.robot.specification import ROBOT_OR_NAME
from mlivr_gym.schema import Choice, FieldPath, Flag, Integer, OrNone, Tuples
from mlivr_gym.settings import SETTINGS
from mlivr_gym.world.grasp_map import MAP

AUTORESET_MODES = {mode.value: mode for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED)}
"""Modes of the vector environment for sub-environments whose episode has ended, by name."""


def _read_autoreset_mode(value: object, path: FieldPath) -> AutoresetMode:
    """Return a mode that is given as itself or by its name."""
    name = value.value if isinstance(value, AutoresetMode) else value
    return AUTORESET_MODES[Choice(tuple(AUTORESET_MODES)).read(name, path)]


AUTORESET_MODE = Reader(_read_autoreset_mode)
"""Validator of an autoreset mode, given as itself or by its name."""

EPISODE_STEPS = Integer(1, 2**62)
"""Validator of the number of steps after which an episode is truncated."""

ENV_ARGUMENTS: Validators = {
    **SETTINGS.validators,
    "robot": ROBOT_OR_NAME,
    "cargo": WithError(RobotError, OrNone(CARGO)),
    "map": MAP,
    "goal_tolerance": NOT_NEGATIVE,
    "reward": REWARD,
    "success_bonus": ANY_NUMBER,
    "shaping": Flag(),
    "discount": Tuples((), float(np.finfo(float).tiny), 1.0),
    "tasks": TASKS,
    "dynamics": Choice(DYNAMICS),
    **dict.fromkeys(("limits", "controller", "disturbances", "physics"), Reader(simulation_part)),
    "grasp_failure": GRASP_FAILURE,
    "grasp_failure_seed": SEED,
    "info_regret": Flag(),
    "render_mode": OrNone(Choice(tuple(RENDER_FPS))),
    "width": WIDTH,
    "height": HEIGHT,
    "seed": OrNone(SEED),
    "options": OrNone(RESET_OPTIONS),
}
"""Validators of the arguments of `MlivrEnv` and of its `reset`."""
