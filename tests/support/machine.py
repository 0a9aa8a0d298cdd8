"""What the machine has for the tests: packages that may be missing, memory for workers."""

import math
import re
from pathlib import Path

MAY_BE_MISSING = {
    "coal", "dask", "distributed", "dm_control", "dm_env", "eaik", "imageio",
    "minari", "nbclient", "nbformat", "networkx", "pinocchio", "playwright", "pyarrow",
    "rustworkx", "sb3_contrib", "ssik", "stable_baselines3", "torch", "torchrl", "tqdm", "trimesh",
    "viser", "yaml",
}  # fmt: skip
"""Packages of the extras, by the names under which they are imported."""

WORKER = 2.7e9
"""Memory that a worker of the tests takes [B]."""


def missing_package(error):
    """The package of an extra whose absence is the cause of an error, or None."""
    while error is not None:
        if isinstance(error, ModuleNotFoundError) and error.name in MAY_BE_MISSING:
            return error.name
        error = error.__cause__
    return None


def available_memory(root="/"):
    """Memory that programs may still take [B], on the machine and in a container."""
    found = [math.inf]
    for name, value in (
        ("proc/meminfo", r"MemAvailable: +(\d+) kB"),
        ("sys/fs/cgroup/memory.max", r"^(\d+)$"),
        ("sys/fs/cgroup/memory/memory.limit_in_bytes", r"^(\d+)$"),
    ):
        path = Path(root, name)
        match = re.search(value, path.read_text() if path.exists() else "", re.MULTILINE)
        if match:
            found.append(float(match[1]) * (1024 if value.endswith("kB") else 1))
    return min(found)


def workers(cores, memory):
    """How many workers some cores and some memory [B] are enough for; one at least."""
    return max(1, int(min(cores, memory / WORKER)))
