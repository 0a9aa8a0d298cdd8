"""Objects that several threads use at once: one lock for all that reads one changing world.

Obstacles and occupied points are state of a stance graph, and its planners and environments keep
results and scratch between calls. So one re-entrant lock of the graph is held by each public method
of the graph and of all that works on it.
"""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable
from copy import deepcopy
from operator import attrgetter
from threading import RLock
from typing import Any, ParamSpec, TypeVar
from weakref import WeakValueDictionary

P = ParamSpec("P")
T = TypeVar("T")

_locks: WeakValueDictionary[int, Any] = WeakValueDictionary()
"""The locks of all graphs."""

_forking = RLock()
"""Held while a process forks."""

_held: list[Any] = []
"""Locks that are held while a process forks."""


def new_lock() -> Any:
    """Return a re-entrant lock, which no other thread holds when a process forks."""
    lock = RLock()
    _locks[id(lock)] = lock
    return lock


def _hold_all() -> None:
    """Wait until no other thread changes an object, since a forked process has no such threads."""
    _forking.acquire()
    _held[:] = filter(None, [find() for find in _locks.valuerefs()])
    for lock in _held:
        lock.acquire()


def _release_all() -> None:
    """Release the locks after a fork, in both processes."""
    while _held:
        _held.pop().release()
    _forking.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_hold_all, after_in_parent=_release_all, after_in_child=_release_all)


def locked(method: Callable[P, T]) -> Callable[P, T]:
    """Return a method that one thread at a time runs, under the attribute `lock` of its object."""

    @functools.wraps(method)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        self: Any = args[0]
        with self.lock:
            return method(*args, **kwargs)

    return call


class Locked:
    """Base class of objects with a `lock`, under which one thread at a time runs their methods.

    These are the public methods of every class below it. Properties take the lock if they say so.
    """

    def __init_subclass__(cls, **given: Any) -> None:
        """Let the public methods of a class take the lock."""
        super().__init_subclass__(**given)
        for name, member in list(vars(cls).items()):
            if inspect.isfunction(member) and not name.startswith("_"):
                setattr(cls, name, locked(member))


class OnGraph(Locked):
    """Base class of objects that work on a stance graph, their attribute `graph`.

    Objects on one graph may be used by several threads: they share its lock.
    """

    lock = property(attrgetter("graph.lock"), doc="The lock of the graph.")


class Independent:
    """Base class of objects that change in use: a shallow copy shares no more than a deep one."""

    def __copy__(self) -> Any:
        """Return a deep copy."""
        return deepcopy(self)
