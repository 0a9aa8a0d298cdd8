"""Kernels that Python interprets, from the source that is otherwise compiled.

Kernels call each other by the names in their modules. What is interpreted is a copy of a function
whose names mean such copies, too, so that nothing is compiled on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import RLock
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from mlivr_gym.compiled.records import readable

_lock = RLock()

_modules: dict[int, dict[str, Any]] = {}
"""The names of modules whose kernels are interpreted, by the identity of their own names."""

_functions: dict[Callable[..., Any], Callable[..., Any]] = {}
"""Interpreted kernels by their functions."""


class _Module:
    """A module with other names."""

    def __init__(self, names: dict[str, Any]) -> None:
        """Take the names, which may still grow."""
        self.__dict__ = names


def interpreted(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of a kernel, as it is in the source, with interpreted callees.

    It takes records as `as_readable` returns them.
    """
    with _lock:  # what is half made would call compiled kernels in a way that ends the process
        if function not in _functions:
            names = _interpreted_names(function.__globals__)
            _functions[function] = FunctionType(
                function.__code__,
                names,
                function.__name__,
                function.__defaults__,
                function.__closure__,
            )
        return _functions[function]


def _interpreted_names(names: dict[str, Any]) -> dict[str, Any]:
    """Return the names of a module, in which kernels are interpreted."""
    known = _modules.get(id(names))
    if known is not None:
        return known
    copied = _modules[id(names)] = dict(names)  # before its kernels, which may call each other
    for name, value in names.items():
        if isinstance(value, ModuleType) and value.__name__.startswith("mlivr_gym."):
            copied[name] = _Module(_interpreted_names(vars(value)))
        elif callable(getattr(value, "py_func", None)):
            copied[name] = interpreted(value.py_func)
    return copied


def as_readable(argument: Any) -> Any:
    """Return an argument of a kernel, with records whose fields can be read as attributes."""
    if isinstance(argument, np.ndarray | np.void):
        return argument if argument.dtype.names is None else argument.view(readable(argument.dtype))
    if isinstance(argument, tuple):
        inner = map(as_readable, argument)
        return type(argument)(*inner) if hasattr(argument, "_fields") else tuple(inner)
    return argument
