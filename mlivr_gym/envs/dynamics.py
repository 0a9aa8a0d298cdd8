"""The two dynamics of an environment: steps of the stance graph, or steps executed in MuJoCo.

MuJoCo's part is imported only if it is used.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError
from mlivr_gym.schema import FieldPath

DYNAMICS = ("kinematic", "mujoco")
"""Names of the dynamics."""


def check_dynamics(dynamics: str, *, transitions: bool, grasp_failure: float | Array) -> None:
    """Check that the dynamics of `MlivrEnv` support the other arguments.

    Raises a `SettingError` if an argument is not; the message names it.
    """
    if dynamics == "kinematic":
        return
    if not transitions:
        raise SettingError(
            "dynamics='mujoco' needs transitions=True: unchecked steps cannot be executed"
        )
    if np.any(np.asarray(grasp_failure) > 0.0):
        raise SettingError("failure probabilities (grasp_failure) need dynamics='kinematic'")


def simulation_part(given: Any, path: FieldPath) -> Any:
    """Return a part of a `Setup`, named as its argument, after checking it."""
    if given is not None:
        from mlivr_gym.simulation.setup import Setup

        Setup.of(**{path.path: given})
    return given
