"""Labels and captions of a picture: each one legible."""

import numpy as np

from mlivr_gym.pictures.captions import with_caption, with_labels


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


def test_the_end_of_a_caption_that_is_too_long_is_left_out_in_words():
    """It does not run into the margin at the right, and is the one of the words that fit."""
    blank = np.zeros((200, 200, 3), dtype=np.uint8)
    text = "stopped since no step leads away from the points that the limbs hold"
    words, shown = text.split(), with_caption(blank, text, 222)
    assert (shown[200:, 190:] == 255).all()
    fitting = [with_caption(blank, " ".join([*words[:k], "..."]), 222) for k in range(1, 13)]
    assert sum(np.array_equal(shown, one) for one in fitting) >= 1
    whole = with_caption(blank, "stopped", 222)
    assert not np.array_equal(whole, with_caption(blank, "stopped ...", 222))
