"""Labels of a picture: each one legible."""

import numpy as np

from mlivr_gym.pictures.captions import with_labels


def test_a_label_that_would_cover_one_before_it_is_omitted():
    blank = np.zeros((300, 400, 3), dtype=np.uint8)
    first, second = ("12", "#ff0000"), ("34", "#0000ff")

    def drawn(places, labels):
        return with_labels(blank, np.array(places, dtype=float), labels)

    alone = drawn([(100, 100)], [first])
    assert alone.any()
    np.testing.assert_array_equal(drawn([(100, 100), (106, 104)], [first, second]), alone)
    both = drawn([(100, 100), (200, 100)], [first, second])
    np.testing.assert_array_equal(both[:, :150], alone[:, :150])
    np.testing.assert_array_equal(both[:, 150:], drawn([(200, 100)], [second])[:, 150:])
