import pytest

from mlivr_gym.errors import MlivrError, shortened
from mlivr_gym.values import MAX_LENGTH, check_unique, read_numbers

NO_NUMBERS = [
    None, True, "1", [1], {}, float("nan"), float("inf"), 10**400, [[1, 2], [3]], ["1", "2", "3"],
    [1, 2, None], [True, False, True], [1, 2, "x"], object(),
]  # fmt: skip


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: shortened(value)[:20])
def test_what_is_no_number_is_refused_by_name(value):
    with pytest.raises(MlivrError, match=r"^width "):
        read_numbers(value, (), "width", MlivrError)
    with pytest.raises(MlivrError, match=r"^place[ \[]"):
        read_numbers(value, (3,), "place", MlivrError)


def test_the_number_that_is_wrong_is_named():
    with pytest.raises(MlivrError, match=r"^rows\[1\]\[0\] is 5000, larger than 1000 m"):
        read_numbers([[1, 2], [5000, 3]], (2, 2), "rows", MlivrError, MAX_LENGTH)
    with pytest.raises(MlivrError, match=r"^rows\[1\]\[1\] is nan; it must be a finite number"):
        read_numbers([[1, 2], [5, float("nan")]], (2, 2), "rows", MlivrError, MAX_LENGTH)


def test_an_id_that_appears_twice_is_named():
    check_unique(["a", "b"], "box", MlivrError)
    with pytest.raises(MlivrError, match="box 'a' appears more than once"):
        check_unique(["a", "b", "a"], "box", MlivrError)
