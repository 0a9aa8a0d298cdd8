"""How long calls take."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that a call takes, and what it returns."""
    began = time.perf_counter()
    value = call()
    return time.perf_counter() - began, value


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Median and 95th percentile [ms], and how many."""
    median, p95 = 1e3 * np.percentile(seconds, (50, 95))
    return {"median": float(median), "p95": float(p95), "count": len(seconds)}
