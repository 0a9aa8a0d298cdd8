"""The graph: stances that can be held, the steps between them, and their tables.

`mlivr_gym.stance_graph` builds it for a robot on a map. A `State` is a stance with the branches on
which each limb may hold; `successors` of a graph are the steps that leave it.
"""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.stances.build import in_same_world
    from mlivr_gym.stances.random_states import TRIES, random_state
    from mlivr_gym.stances.stance_graph import StanceGraph
    from mlivr_gym.stances.table_build import build_table, find_table, write_built
    from mlivr_gym.stances.table_files import TableError
    from mlivr_gym.transitions.state import State, Successors

__all__ = [
    "TRIES",
    "StanceGraph",
    "State",
    "Successors",
    "TableError",
    "build_table",
    "find_table",
    "in_same_world",
    "random_state",
    "write_built",
]

__getattr__, __dir__ = lazy(__name__)
