"""The queue of nodes against the heap of Python."""

import heapq

from compiled import called
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.planners.open_queue import (
    NO_ENTRY,
    NodeQueue,
    least_estimate,
    pop,
    push,
    requeue,
)


@given(st.lists(st.none() | st.floats(0.0, 1e3) | st.integers(0, 3).map(float)))
def test_what_is_taken_has_the_least_estimate(actions):
    """Nothing takes a node; a number is put in, and there is always room."""
    queue, plain, estimate_of, node = NodeQueue.allocate(1), [], {}, 0
    for action in (*actions, *[None] * len(actions), None):
        if action is not None:
            if queue.status["entry_count"] == len(queue.node):
                queue = queue.doubled()
            called(push)(queue, action, node)
            heapq.heappush(plain, action)
            estimate_of[node] = action
            node += 1
        elif plain:
            assert called(least_estimate)(queue) == queue.lower_bound == plain[0]
            entry = int(called(pop)(queue))
            assert estimate_of[entry] == plain[0]
            called(requeue)(queue, estimate_of[entry], entry)
            again = int(called(pop)(queue))
            assert estimate_of.pop(int(queue.node[again])) == heapq.heappop(plain)
        else:
            assert called(pop)(queue) == NO_ENTRY
            assert called(least_estimate)(queue) == queue.lower_bound == float("inf")
            return
    assert not plain
    assert not estimate_of
