"""Entries of map files, and a small map of a wall."""

from functools import cache

import numpy as np

from mlivr_gym.world.grasp_map import jem_map

POINT = {"id": "P", "face": "deck", "position": [0, 0, 0], "normal": [0, 0, 1], "rail": [1, 0, 0]}


SEGMENT = {"id": "S", "face": "aft", "start": [0, 1, 0], "end": [0, 1, 1], "normal": [0, -1, 0]}


RAIL = {"id": "H", "face": "deck", "min": [4, 0, 0], "max": [5, 1, 1]}


BOX = {"id": "B", "min": [6, 0, 0], "max": [7, 1, 1]}


LADDER = {
    "segments": [
        {"id": f"R{k}", "face": "deck", "start": [x, -0.4, 0.0], "end": [x, 0.4, 0.0],
         "normal": [0, 0, 1]}
        for k, x in enumerate((0.0, 0.9, 1.8))
    ],
    "cabin": {"min": [-1, -1, 0], "max": [3, 1, 2]},
}  # fmt: skip
"""A user's own map: three short rails on a floor."""


@cache
def few_of_a_wall(count):
    """Some points of the JEM's forward wall."""
    jem = jem_map()
    chosen = np.flatnonzero((np.array(jem.faces) == "forward") & (jem.positions[:, 0] < 5.5))
    chosen = chosen[np.linspace(0, len(chosen) - 1, count).astype(int)]
    return jem.subset(np.isin(np.arange(len(jem)), chosen), "few")


BRIDGE = {
    "name": "bridge",
    "segments": [
        {
            "id": f"R{k}", "face": "floor", "start": [x, -half, 0], "end": [x, half, 0],
            "normal": [0, 0, 1],
        }
        for k, (x, half) in enumerate(
            ((0.0, 0.3), (0.4, 0.3), (2.0, 0.05), (4.0, 0.3), (4.4, 0.3))
        )
    ],
    "cabin": {"min": [-2, -2, -1], "max": [8, 2, 3]},
}  # fmt: skip
"""Two platforms of two rails each, and one point between them, `R2:0`."""
