"""What steps that are executed do not go together with."""

import numpy as np
import pytest

from mlivr_gym.envs.dynamics import check_dynamics
from mlivr_gym.errors import SettingError

GOOD = {"transitions": True, "precompute": False, "grasp_failure": 0.0}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"transitions": False}, "needs transitions=True"),
        ({"precompute": True}, "need dynamics='kinematic'"),
        ({"grasp_failure": 0.1}, "need dynamics='kinematic'"),
        ({"grasp_failure": np.array([0.0, 0.0, 0.2])}, "need dynamics='kinematic'"),
    ],
    ids=str,
)
def test_each_setting_alone_is_refused_with_simulated_steps(change, words):
    check_dynamics("kinematic", **(GOOD | change))
    check_dynamics("mujoco", **GOOD)
    check_dynamics("mujoco", **(GOOD | {"grasp_failure": np.zeros(3)}))
    with pytest.raises(SettingError, match=words):
        check_dynamics("mujoco", **(GOOD | change))
