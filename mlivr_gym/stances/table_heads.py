"""What a file with a table says of the graph that it is of, so that no other uses it."""

from __future__ import annotations

import json
from dataclasses import asdict

from mlivr_gym.settings import GRAPH_RULES
from mlivr_gym.stances.stance_graph import StanceGraph


def head_of(graph: StanceGraph, form: int) -> list[str]:
    """Format, rules, robot, map and settings, the first entry of a file."""
    settings = json.dumps(asdict(graph.settings), sort_keys=True)
    robot, grasp_map = graph.robot.fingerprint, graph.grasp_map.fingerprint
    return [str(form), str(GRAPH_RULES), robot, grasp_map, settings]


def difference(found: list[str], graph: StanceGraph, form: int) -> str:
    """What is another in the head of a file than in that of a graph; empty if nothing is."""
    needed = head_of(graph, form)
    if found == needed:
        return ""
    if found[0] != needed[0]:
        return f"of format {found[0]}, and this version has format {form}"
    if len(found) != len(needed):
        return "of a robot, map and settings that it does not name"
    if found[1] != needed[1]:
        return f"of rules {found[1]}, and this version has rules {GRAPH_RULES}"
    others = [
        f"another {name}"
        for name, one, other in zip(("robot", "map"), found[2:4], needed[2:4], strict=True)
        if one != other
    ]
    theirs, ours = json.loads(found[4]), json.loads(needed[4])
    names = [name for name in sorted({*theirs, *ours}) if theirs.get(name) != ours.get(name)]
    if names:
        others.append(f"other settings ({', '.join(names)})")
    return f"of {' and '.join(others)}"
