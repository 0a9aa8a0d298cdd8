"""The queue of nodes against lists of Python."""

from compiled import called
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.planners.bucket_queue import (
    LISTS,
    NOTHING,
    NodeQueue,
    least_waiting,
    put,
    put_back,
    take,
)

LOW, WIDTH = 0.5, 0.25
FAR = LOW + WIDTH * (LISTS + 4)


@given(st.lists(st.none() | st.integers(0, 24).map(lambda k: LOW + k / 8) | st.just(FAR)))
def test_what_is_taken_is_of_the_first_list_that_holds_something(actions):
    """Nothing takes a node; a number is put in, and there is always room."""
    waiting, plain, last, node = NodeQueue.of(1, LOW, WIDTH), {}, 0, 0
    for action in (*actions, *[None] * len(actions), None):
        if action is not None:
            if waiting.filled["used"] == len(waiting.node):
                waiting = waiting.wider()
            called(put)(waiting, action, node)
            plain[node] = max(min(int((action - LOW) / WIDTH), LISTS - 1), last)
            node += 1
        elif plain:
            first, entry = min(plain.values()), int(called(take)(waiting))
            called(put_back)(waiting, entry)
            assert called(take)(waiting) == entry
            assert plain.pop(int(waiting.node[entry])) == first
            assert called(least_waiting)(waiting) == waiting.least == LOW + WIDTH * first
            last = first
        else:
            assert called(take)(waiting) == NOTHING
            return
    assert not plain
