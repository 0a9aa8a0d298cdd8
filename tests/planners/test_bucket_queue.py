"""The queue of nodes against lists of Python."""

from compiled import called
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.planners.bucket_queue import (
    BUCKETS,
    NO_ENTRY,
    NodeQueue,
    pop,
    push,
    queue_lower_bound,
    requeue,
)

LOW, WIDTH = 0.5, 0.25
FAR = LOW + WIDTH * (BUCKETS + 4)


@given(st.lists(st.none() | st.integers(0, 24).map(lambda k: LOW + k / 8) | st.just(FAR)))
def test_what_is_taken_is_of_the_first_list_that_holds_something(actions):
    """Nothing takes a node; a number is put in, and there is always room."""
    queue, plain, last, node = NodeQueue.allocate(1, LOW, WIDTH), {}, 0, 0
    for action in (*actions, *[None] * len(actions), None):
        if action is not None:
            if queue.status["entry_count"] == len(queue.node):
                queue = queue.doubled()
            called(push)(queue, action, node)
            plain[node] = max(min(int((action - LOW) / WIDTH), BUCKETS - 1), last)
            node += 1
        elif plain:
            first, entry = min(plain.values()), int(called(pop)(queue))
            called(requeue)(queue, entry)
            assert called(pop)(queue) == entry
            assert plain.pop(int(queue.node[entry])) == first
            assert called(queue_lower_bound)(queue) == queue.lower_bound == LOW + WIDTH * first
            last = first
        else:
            assert called(pop)(queue) == NO_ENTRY
            return
    assert not plain
