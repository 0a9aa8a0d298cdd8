"""Colours of points by their meaning: reachable by a step, or why not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from mlivr_gym.errors import StanceError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State, Successors

POINT_COLOUR, OCCUPIED_COLOUR, FAINT_COLOUR, SHARED_COLOUR = (
    "#f2bf1a", "#1b1b1f", "#cfd3d8", "#8a3fb0",
)  # fmt: skip
"""Colours of points, of occupied ones, of points without meaning, and of several limbs."""

NO_STEP = "no step: the support limbs cannot follow the base, or every swing is in collision"
"""Reason for a point whose stance can be held, but that no step reaches."""

REASONS = {
    "is occupied": ("occupied", OCCUPIED_COLOUR),
    "apart": ("too close to a held point, or farther than the span", FAINT_COLOUR),
    "touches": ("every posture is in collision", "#e8590c"),
    "out of reach": ("out of reach", "#868e96"),
    "manipulability": ("manipulability below a threshold", "#7048e8"),
    "depart": ("the limb could not depart", "#1098ad"),
    "no step": ("no step leads there", "#d6336c"),
    "held": ("held", POINT_COLOUR),
}
"""Legend and colour of each reason, by a part of its sentence; the first match counts."""

FREE_COLOUR = "#2b8a3e"
"""Colour of points that a step reaches, if reasons are shown."""


class Marks(NamedTuple):
    """Colours of the points of a map with their legend."""

    colours: list[str]
    """Hexadecimal colour of each point."""
    legend: list[tuple[str, str]]
    """Colour and text of each entry of the legend."""
    points: Sequence[int] = ()
    """Indices of the points whose colours have a meaning; they are enlarged."""


def plain_marks(graph: StanceGraph) -> Marks:
    """Return one colour for all points, and a dark one for occupied points."""
    colours = [POINT_COLOUR] * len(graph.grasp_map)
    for point in graph.occupied:
        colours[point] = OCCUPIED_COLOUR
    legend = [(OCCUPIED_COLOUR, f"occupied: {len(graph.occupied)}")] if graph.occupied else []
    return Marks(colours, legend)


def reach_marks(graph: StanceGraph, state: State) -> Marks:
    """Return the colours of the limbs for the points that they can step to."""
    steps = graph.successors(state)
    limbs = _limbs_by_point(steps)
    colours = [FAINT_COLOUR] * len(graph.grasp_map)
    for point, reaching in limbs.items():
        colours[point] = LIMB_COLOURS[reaching[0]] if len(reaching) == 1 else SHARED_COLOUR
    counts = Counter(steps.limb.tolist())
    legend = [(LIMB_COLOURS[i], f"limb {i}: {counts[i]} points") for i in range(graph.limbs)]
    shared = sum(len(reaching) > 1 for reaching in limbs.values())
    legend.append((SHARED_COLOUR, f"several limbs: {shared}"))
    return Marks(colours, legend, sorted(limbs))


def blocked_marks(graph: StanceGraph, state: State, limb: int) -> Marks:
    """Return the colours of the reasons why a limb cannot step to points."""
    steps, count = graph.successors(state), Counter[str]()
    colours = [FAINT_COLOUR] * len(graph.grasp_map)
    for point in range(len(graph.grasp_map)):
        kind = reason_of(why_not(graph, state, limb, point, steps))
        colours[point] = REASONS[kind][1] if kind else FREE_COLOUR
        count[kind] += 1
    legend = [(FREE_COLOUR, f"a step leads there: {count['']}")]
    legend += [
        (colour, f"{text}: {count[kind]}")
        for kind, (text, colour) in REASONS.items()
        if count[kind]
    ]
    chosen = [p for p, colour in enumerate(colours) if colour != FAINT_COLOUR]
    return Marks(colours, legend, chosen)


def why_not(graph: StanceGraph, state: State, limb: int, point: int, steps: Successors) -> str:
    """Return why a limb cannot step to a point, given by its index; `""` if it can.

    The step leaves `state`, whose successors are `steps`.
    """
    name = graph.grasp_map.ids[point]
    if point in state.stance:
        return f"point {name!r} is held by limb {state.stance.index(point)}"
    if steps.find(limb, point) >= 0:
        return ""
    try:
        graph.state((*state.stance[:limb], point, *state.stance[limb + 1 :]))
    except StanceError as error:
        return str(error)
    return NO_STEP


def reason_of(sentence: str) -> str:
    """Return the key of `REASONS` of a sentence, `""` for none."""
    return next((kind for kind in REASONS if kind in sentence), "") if sentence else ""


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


def _limbs_by_point(steps: Successors) -> dict[int, list[int]]:
    """Return the limbs that can step to each point."""
    limbs: dict[int, list[int]] = {}
    for limb, point in zip(steps.limb.tolist(), steps.point.tolist(), strict=True):
        limbs.setdefault(point, []).append(limb)
    return limbs
