"""Stance graphs that tests share: whoever changes the world of one must put it back."""

SHARED = []
"""The graphs of fixtures that outlive a test."""


def shared(graph):
    """Watch a graph from now on."""
    SHARED.append(graph)
    return graph


def put_back():
    """What was left in the worlds of shared graphs, which are empty again afterwards."""
    changed = [
        f"{graph.grasp_map.name} of {graph.robot.name}: {len(graph.obstacles)} obstacles, "
        f"{len(graph.occupied)} occupied points"
        for graph in SHARED
        if graph.obstacles or graph.occupied
    ]
    for graph in SHARED if changed else ():
        graph.remove_obstacles()
        graph.vacate()
    return changed
