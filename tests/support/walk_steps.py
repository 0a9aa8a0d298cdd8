"""How many steps of a walk a graph has."""

from mlivr_gym.errors import StanceError


def count_steps(graph, stances):
    """Steps of a sequence of stances that the graph has, from the first on."""
    points = [graph.indices(stance) for stance in stances]
    try:
        state = graph.state(points[0])
    except StanceError:
        return 0
    return len(graph.states_along(state, points[1:])) - 1
