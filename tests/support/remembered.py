"""What a graph says of a state, asked of it once for all the searches of a test."""

from contextlib import contextmanager
from functools import cache


@contextmanager
def remembered(graph, *names):
    """Some methods of a graph answer each question once while its world stays as it is.

    Searches of different costs and goals from the same starts meet the same states: asked once,
    they take a fraction of the time, and are given the same.
    """
    for name in names:
        setattr(graph, name, cache(getattr(graph, name)))
    try:
        yield graph
    finally:
        for name in names:
            delattr(graph, name)
