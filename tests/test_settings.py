import pytest

from mlivr_gym.settings import Settings, base_threshold


def test_base_threshold_falls_with_the_cube_of_the_number_of_limbs():
    assert [base_threshold(n) for n in (2, 4)] == [0.001, 0.000125]
    assert Settings().thresholds(3) == (0.1, pytest.approx(0.001 * 8 / 27))
    assert Settings(manipulability=False).thresholds(2) == (0.0, 0.0)
