"""Type aliases of the arrays in signatures; docstrings give shapes and units."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of real numbers in double precision."""

IntArray = NDArray[np.int64]
"""Array of 64-bit integers: indices, counts or masks."""

BoolArray = NDArray[np.bool_]
"""Array of truth values."""
