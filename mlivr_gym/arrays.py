"""The kinds of arrays that signatures name; docstrings give their shapes and units."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real numbers."""

IntArray = NDArray[np.int64]
"""Indices, counts and masks."""

BoolArray = NDArray[np.bool_]
"""Truth values."""
