import pytest

from mlivr_gym.errors import SettingError
from mlivr_gym.settings import Settings, base_threshold


def test_base_threshold_falls_with_the_cube_of_the_number_of_limbs():
    assert [base_threshold(n) for n in (2, 4)] == [0.001, 0.000125]
    assert Settings().thresholds(3) == (0.1, pytest.approx(0.001 * 8 / 27))
    assert Settings(manipulability=False).thresholds(2) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"collisions": "yes"}, "collisions is 'yes'; it must be true or false"),
        ({"clearance": -0.1}, "clearance is -0.1"),
        ({"limb_threshold": None}, "limb_threshold is None"),
        ({"base_threshold": "low"}, "base_threshold is 'low'"),
        ({"path_floor": 10**400}, "path_floor is"),
        ({"clearance": 20000.0}, "clearance is 20000, larger than 100 m; .*millimetres"),
    ],
)
def test_a_faulty_setting_is_named(fault, words):
    with pytest.raises(SettingError, match=f"^{words}"):
        Settings(**fault)
