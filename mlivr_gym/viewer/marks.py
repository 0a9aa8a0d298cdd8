"""Colours of points that limbs can step to, and why they cannot step to others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from mlivr_gym.errors import StanceError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

POINT_COLOUR, OCCUPIED_COLOUR, FAINT_COLOUR, SHARED_COLOUR = (
    "#f2bf1a", "#1b1b1f", "#cfd3d8", "#8a3fb0",
)  # fmt: skip
"""Colours of points, of occupied ones, of points out of reach, and of several limbs."""

NO_STEP = "no step: the support limbs cannot follow the base, or every swing is in collision"
"""Reason for a point whose stance can be held, but that no step reaches."""


class Marks(NamedTuple):
    """Colours of the points of a map with their legend."""

    colours: list[str]
    """Hexadecimal colour of each point."""
    legend: list[tuple[str, str]]
    """Colour and text of each entry of the legend."""
    points: Sequence[int]
    """Indices of the points whose colours have a meaning; they are enlarged."""


def point_marks(graph: StanceGraph, reached_from: State | None = None) -> Marks:
    """Return one colour for all points, and a dark one for occupied points.

    With a state, points that limbs can step to from it have the colours of the limbs.
    """
    occupied = sorted(graph.occupied)
    legend = [(OCCUPIED_COLOUR, f"occupied: {len(occupied)}")] if occupied else []
    plain = POINT_COLOUR if reached_from is None else FAINT_COLOUR
    colours, limbs = [plain] * len(graph.grasp_map), dict[int, list[int]]()
    for point in occupied:
        colours[point] = OCCUPIED_COLOUR
    if reached_from is not None:
        steps = graph.successors(reached_from)
        for limb, point in zip(steps.limb.tolist(), steps.point.tolist(), strict=True):
            limbs.setdefault(point, []).append(limb)
        for point, reaching in limbs.items():
            colours[point] = LIMB_COLOURS[reaching[0]] if len(reaching) == 1 else SHARED_COLOUR
        counts, shared = Counter(steps.limb.tolist()), sum(len(some) > 1 for some in limbs.values())
        legend += [(LIMB_COLOURS[i], f"limb {i}: {counts[i]} points") for i in range(graph.limbs)]
        legend.append((SHARED_COLOUR, f"several limbs: {shared}"))
    return Marks(colours, legend, [*occupied, *limbs])


def explanations(graph: StanceGraph, state: State, point: int) -> list[str]:
    """Return a line for each limb: that it can step from a state to a point, or why not."""
    steps, name = graph.successors(state), graph.grasp_map.ids[point]
    lines = []
    for limb in range(graph.limbs):
        why = "can step to this point"
        if point in state.stance:
            why = f"point {name!r} is held by limb {state.stance.index(point)}"
        elif steps.find(limb, point) < 0:
            try:
                graph.state((*state.stance[:limb], point, *state.stance[limb + 1 :]))
                why = NO_STEP
            except StanceError as error:
                why = str(error)
        lines.append(f"limb {limb}: {why}")
    return lines


def states_of(graph: StanceGraph, plan: Plan) -> tuple[State | None, ...]:
    """Return the states along a plan in the current world, None after a step that is impossible."""
    motion, stances = plan.motion, plan.stances
    states: tuple[State, ...] = ()
    try:
        where = graph.given_pose_of(
            stances[0], motion.base_positions[0], motion.base_quaternions[0]
        )
        start = graph.state(stances[0], where)
        states = graph.states_along(start, [graph.indices(stance) for stance in stances[1:]])
    except StanceError:
        pass
    return *states, *[None] * (len(stances) - len(states))
