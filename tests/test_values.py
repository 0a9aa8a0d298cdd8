import numpy as np
import pytest

from mlivr_gym.errors import MlivrError, SettingError, shown
from mlivr_gym.values import LONGEST, entries, number, numbers, rotation, text, whole

NO_NUMBERS = [
    None, True, "1", [1], {}, float("nan"), float("inf"), 10**400, [[1, 2], [3]], ["1", "2", "3"],
    [1, 2, None], [True, False, True], [1, 2, "x"], object(),
]  # fmt: skip


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: shown(value)[:20])
def test_what_is_no_number_is_refused_by_name(value):
    with pytest.raises(MlivrError, match=r"^width "):
        number(value, "width", MlivrError)
    with pytest.raises(MlivrError, match=r"^place "):
        numbers(value, (3,), "place", MlivrError)


def test_numbers_are_returned_as_they_are():
    assert number(3, "width", MlivrError) == 3.0
    assert number(np.float32(0.5), "width", MlivrError) == 0.5
    np.testing.assert_array_equal(
        numbers([1, 2.5, 10**25], (3,), "place", MlivrError), [1.0, 2.5, 1e25]
    )
    with pytest.raises(MlivrError, match=r"has shape \(2,\)"):
        numbers([1, 2], (3,), "place", MlivrError)


def test_lengths_above_the_largest_hint_at_millimetres():
    assert number(-LONGEST, "width", MlivrError, LONGEST) == -LONGEST
    with pytest.raises(MlivrError, match=r"width is 1000\.5, larger than 1000 m; .*millimetres"):
        number(1000.5, "width", MlivrError, LONGEST)


@pytest.mark.parametrize("value", ["", "a\nb", "a\0", "\ud800", "x" * 201, 3, None, ["a"]])
def test_what_cannot_be_a_name_is_refused(value):
    with pytest.raises(MlivrError, match=r"^the id is ") as told:
        text(value, "the id", MlivrError)
    assert str(told.value).isprintable()
    assert len(str(told.value)) < 300


def test_names_may_be_of_any_language():
    assert all(
        text(name, "the id", MlivrError) == name
        for name in ("D2a:4", "tool bag", "étagère", "きぼう")
    )


def test_whole_numbers_lists_and_rotations_are_checked():
    assert whole(np.int64(3), "seed", SettingError, 0, 3) == 3
    for value in (True, 2.0, -1, 4, "1", 10**5000):
        with pytest.raises(SettingError, match=r"^seed is .* from 0 to 3"):
            whole(value, "seed", SettingError, 0, 3)
    with pytest.raises(MlivrError, match="boxes must be a list"):
        entries({}, "boxes", MlivrError)
    with pytest.raises(MlivrError, match="boxes has 3 entries; at most 2"):
        entries([1, 2, 3], "boxes", MlivrError, 2)
    for value in (np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3), np.full((3, 3), 1e300)):
        with pytest.raises(MlivrError, match="right-handed"):
            rotation(value, "turn", MlivrError)
