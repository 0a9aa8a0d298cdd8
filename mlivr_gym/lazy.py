"""Public names of a package, whose modules are imported when a name is first asked for."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any


def lazy(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package.

    The package imports its public names under `if TYPE_CHECKING:`, where type checkers and readers
    find them; here they are imported from the same places, each when it is first asked for, since
    Numba, MuJoCo and PyTorch load slowly and few programs need all of them.
    """
    this_package = sys.modules[package]

    @cache
    def places() -> dict[str, str]:
        """Return the module of each name."""
        named = [
            node
            for block in ast.parse(inspect.getsource(this_package)).body
            if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
            for node in block.body
            if isinstance(node, ast.ImportFrom)
        ]
        return {alias.name: str(node.module) for node in named for alias in node.names}

    def get(name: str) -> Any:
        if name.startswith("__") or name not in places():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        found = vars(this_package)[name] = getattr(import_module(places()[name]), name)
        return found

    return get, lambda: sorted({*vars(this_package), *places()})
