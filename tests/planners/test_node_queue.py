"""The queue of nodes against the heap of Python's library."""

import heapq

from compiled import called
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.planners.node_queue import NodeQueue, drop, put


@given(st.lists(st.none() | st.floats(-2.0, 2.0).map(lambda f: round(f, 1))))
def test_the_smallest_comes_first(actions):
    """Nothing takes the first entry; a number is put in, and there is always room."""
    waiting, plain, made, node = NodeQueue.of(1), [], {}, 0
    for action in (*actions, *[None] * len(actions)):
        if action is not None:
            if len(plain) == len(waiting.f):
                waiting = waiting.wider()
            called(put)(waiting, len(plain), action, node)
            made[node], node = action, node + 1
            heapq.heappush(plain, action)
        elif plain:
            assert made.pop(int(waiting.node[0]), None) == waiting.f[0] == heapq.heappop(plain)
            called(drop)(waiting, len(plain))
    assert not plain
