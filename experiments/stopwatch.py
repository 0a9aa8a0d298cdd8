"""How long calls take, and in which functions the time is spent."""

from __future__ import annotations

import cProfile
import pstats
import time
from collections.abc import Callable
from typing import Any


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that a call takes, and what it returns."""
    began = time.perf_counter()
    value = call()
    return time.perf_counter() - began, value


def shares(call: Callable[[], Any], names: dict[str, str]) -> dict[str, float]:
    """Share of a call's profiled time inside each of the named functions.

    Args:
        call: What is profiled.
        names: What each function does, by its name; the result has these descriptions as keys.
    """
    profile = cProfile.Profile()
    profile.runcall(call)
    stats: Any = pstats.Stats(profile)
    spent = dict.fromkeys(names.values(), 0.0)
    for (_, _, function), (_, _, _, cumulative, _) in stats.stats.items():
        if function in names:
            spent[names[function]] += cumulative / stats.total_tt
    return spent | {"rest": max(0.0, 1.0 - sum(spent.values()))}
