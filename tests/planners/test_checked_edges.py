"""The table of known steps against a dictionary."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.stances.checked_edges import CheckedEdges

BIT = st.integers(0, 40) | st.integers(0, 1 << 40)


EDGE = st.tuples(BIT, st.tuples(st.integers(0, 1 << 48), st.booleans()))


@given(st.lists(st.lists(EDGE, max_size=20), max_size=6))
def test_it_holds_what_was_put_in_last(groups):
    known, plain = CheckedEdges.empty(50, capacity=4), {}
    for group in groups:
        nodes = np.array([bit % 50 for bit, _ in group], dtype=np.int64)
        bits = np.array([bit for bit, _ in group], dtype=np.int64)
        kept = np.array([branch_sets for _, (branch_sets, _) in group], dtype=np.uint64)
        is_exact = np.array([exact for _, (_, exact) in group], dtype=np.bool_)
        known = known.with_edges(nodes, bits, kept, is_exact)
        plain.update(group)
        assert len(known.keys) >= 2 * len(plain)
    assert np.flatnonzero(known.has_edges).tolist() == sorted({bit % 50 for bit in plain})
    asked = np.array([*plain, 7, 1 << 41], dtype=np.int64)
    assert known.contains(asked).tolist() == [True] * len(plain) + [7 in plain, False]
    bits = np.array([*plain], dtype=np.int64)
    assert known.kept_on(bits).tolist() == [kept for kept, _ in plain.values()]
    assert known.are_exact(asked).tolist()[: len(plain)] == [exact for _, exact in plain.values()]
    assert not known.are_exact(asked[-1:]).any()
