"""Kernels, which compiled code alone can call, called from tests."""

import importlib.util
import os
import sys
from functools import cache

from numba import config, njit

from mlivr_gym.compiled.cache import kernel_root

CALLER = """from {module} import {name}
from mlivr_gym.compiled.kernels import entry


@entry
def call(*given):
    return {name}(*given)
"""


@cache
def called(kernel):
    """A kernel as a function that Python can call; its machine code is kept as that of entries."""
    if config.DISABLE_JIT:
        return kernel
    module, name = kernel.__module__, kernel.__name__
    if getattr(sys.modules.get(module), name, None) is not kernel or "mlivr_gym" not in module:
        return njit(error_model="numpy")(lambda *args: kernel(*args))
    path = kernel_root() / "called" / f"{module}.{name}.py"
    source = CALLER.format(module=module, name=name)
    if not path.exists() or path.read_text() != source:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Whole files alone are seen by other processes.
        written = path.with_suffix(f".{os.getpid()}")
        written.write_text(source)
        written.replace(path)
    spec = importlib.util.spec_from_file_location(f"called_{module}_{name}".replace(".", "_"), path)
    caller = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(caller)
    return caller.call
