"""What a graph says is asked of it once, for all the searches of a test or all tests of a file."""

from contextlib import contextmanager
from copy import deepcopy

from mlivr_gym.stances.stance_graph import StanceGraph

STEPS = {}
"""Steps that leave a state, by robot, world and state."""


@StanceGraph.register
class StepsAskedOnce:
    """A graph for searches of different costs, which meet the same states in the same worlds."""

    def __init__(self, graph):
        boxes, taken = tuple(graph.obstacles), frozenset(graph.occupied)
        self.graph, self.world = graph, (graph.grasp_map.fingerprint, graph.robot, boxes, taken)

    def __getattr__(self, name):
        return getattr(self.graph, name)

    def successors(self, state):
        key = self.world, self.graph.settings, state
        if key not in STEPS:
            STEPS[key] = self.graph.successors(state)
        return STEPS[key]


@contextmanager
def stances_solved_once():
    """Graphs of one map, robot and settings are each made anew, with postures solved for the first.

    For commands and environments, each of which makes its own graph of the whole module.
    """
    solve, solved = StanceGraph.postures, {}

    def postures(graph, stances):
        if stances is not graph.pairs:
            return solve(graph, stances)
        key = (graph.grasp_map.fingerprint, graph.robot, graph.settings, stances.tobytes())
        if key not in solved:
            solved[key] = solve(graph, stances)
        return deepcopy(solved[key])

    StanceGraph.postures = postures
    try:
        yield
    finally:
        StanceGraph.postures = solve
