import pytest

from mlivr_gym import Capsule
from mlivr_gym.errors import ShapeError


def test_faulty_capsules_are_named():
    with pytest.raises(ShapeError, match=r"^capsule.link is 'hip'; valid choices are 'base'"):
        Capsule("hip", (0, 0, 0), (0, 0, 1), 0.1)
    with pytest.raises(ShapeError, match=r"^capsule.radius is 0.0; it must be from 1e-09"):
        Capsule("forearm", (0, 0, 0), (0, 0, 1), 0.0)
    with pytest.raises(ShapeError, match="flange axis"):
        Capsule("gripper", (0, 0.1, 0), (0, 0, 1), 0.1)
