"""Grasps that fail: how often, and how likely at each point."""

import numpy as np
import pytest

from mlivr_gym.envs.grasp_failure import failure_probabilities
from mlivr_gym.errors import SettingError

pytestmark = pytest.mark.usefixtures("cache")


def test_failure_probabilities():
    drawn = failure_probabilities(20_000, 0.2, seed=1)
    assert drawn.mean() == pytest.approx(0.2, abs=0.005)
    assert drawn.min() >= 0.0
    assert drawn.max() <= 0.4
    np.testing.assert_array_equal(
        failure_probabilities(3, np.array([0.0, 0.5, 0.9])), [0.0, 0.5, 0.9]
    )
    assert failure_probabilities(20_000, 0.45).max() < 0.95
    with pytest.raises(SettingError, match=r"grasp_failure is 0\.46; .*0 to 0\.45"):
        failure_probabilities(3, 0.46)
    with pytest.raises(SettingError, match="3 numbers"):
        failure_probabilities(3, np.array([0.0, 0.5]))
    with pytest.raises(SettingError, match=r"grasp_failure\[1\] is 1.0; .*0 to 0.95"):
        failure_probabilities(3, np.array([0.0, 1.0, 0.5]))
