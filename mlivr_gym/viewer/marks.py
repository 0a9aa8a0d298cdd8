"""What colours of points tell: which can be stepped to, why others cannot, what a policy likes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import StanceError
from mlivr_gym.motion.plan import Plan
from mlivr_gym.pictures.robot_shapes import pale
from mlivr_gym.robot.specification import LIMB_COLOURS
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State, Successors

POINT_COLOUR, OCCUPIED_COLOUR, FAINT_COLOUR, SHARED_COLOUR = (
    "#f2bf1a", "#1b1b1f", "#cfd3d8", "#8a3fb0",
)  # fmt: skip
"""Colours of points, of occupied ones, of those that do not matter, and of two limbs at once."""

NO_STEP = "no step: the limbs that hold cannot follow, or every swing touches something"
"""Why a point whose stance can be held is not stepped to."""

REASONS = {
    "is occupied": ("occupied", OCCUPIED_COLOUR),
    "apart": ("too near to a held point, or beyond the span", FAINT_COLOUR),
    "touches": ("every posture touches something", "#e8590c"),
    "out of reach": ("out of reach", "#868e96"),
    "manipulability": ("below a threshold of manipulability", "#7048e8"),
    "depart": ("the limb could not depart", "#1098ad"),
    "no step": ("no step leads there", "#d6336c"),
    "held": ("held", POINT_COLOUR),
}
"""Short words and colour of each reason, by what its sentence says; in this order."""

MIN_PROBABILITY = 0.005
"""Least probability of an action that a legend tells."""

FREE_COLOUR = "#2b8a3e"
"""Colour of points that can be stepped to where reasons are shown."""


class Marks(NamedTuple):
    """Colours of points, and what they mean."""

    colours: Array
    """Red, green and blue up to 255, shape (m, 3)."""
    legend: tuple[tuple[str, str], ...] = ()
    """Colour and words."""
    points: tuple[int, ...] = ()
    """Indices of the points that the colours are about, which are drawn larger."""


def plain_marks(graph: StanceGraph) -> Marks:
    """Points in one colour, occupied ones dark."""
    colours = [POINT_COLOUR] * len(graph.grasp_map)
    for point in graph.occupied:
        colours[point] = OCCUPIED_COLOUR
    legend = [(OCCUPIED_COLOUR, f"occupied: {len(graph.occupied)}")] if graph.occupied else []
    return _marks(colours, legend)


def reach_marks(graph: StanceGraph, state: State) -> Marks:
    """Points that limbs can step to, in the colours of the limbs."""
    steps = graph.successors(state)
    limbs = _limbs_by_point(steps)
    colours = [FAINT_COLOUR] * len(graph.grasp_map)
    for point, at in limbs.items():
        colours[point] = LIMB_COLOURS[at[0]] if len(at) == 1 else SHARED_COLOUR
    counts = Counter(steps.limb.tolist())
    legend = [(LIMB_COLOURS[i], f"limb {i}: {counts[i]} points") for i in range(graph.limbs)]
    shared = sum(len(at) > 1 for at in limbs.values())
    legend.append((SHARED_COLOUR, f"several limbs: {shared}"))
    return _marks(colours, legend, sorted(limbs))


def blocked_marks(graph: StanceGraph, state: State, limb: int) -> Marks:
    """Why points cannot be stepped to by a limb."""
    steps, count = graph.successors(state), Counter[str]()
    colours = [FAINT_COLOUR] * len(graph.grasp_map)
    for point in range(len(graph.grasp_map)):
        kind = reason_of(why_not(graph, state, limb, point, steps))
        colours[point] = REASONS[kind][1] if kind else FREE_COLOUR
        count[kind] += 1
    legend = [(FREE_COLOUR, f"can be stepped to: {count['']}")]
    legend += [
        (colour, f"{words}: {count[kind]}")
        for kind, (words, colour) in REASONS.items()
        if count[kind]
    ]
    chosen = [p for p, colour in enumerate(colours) if colour != FAINT_COLOUR]
    return _marks(colours, legend, chosen)


def policy_marks(graph: StanceGraph, probability: Array) -> Marks:
    """Probabilities of a policy's actions, shape (N, m): the darker the likelier."""
    colours = [FAINT_COLOUR] * len(graph.grasp_map)
    best = probability.argmax(axis=0)
    for point in np.flatnonzero(probability.sum(axis=0) > 0.0).tolist():
        share = float(np.sqrt(probability[best[point], point]))
        colours[point] = pale(LIMB_COLOURS[best[point]], 0.8 * (1.0 - share))
    order = np.argsort(-probability, axis=None, kind="stable")[:5]
    legend = []
    for limb, point in zip(*np.unravel_index(order, probability.shape), strict=True):
        if probability[limb, point] >= MIN_PROBABILITY:
            words = f"limb {limb} → {graph.grasp_map.ids[point]}: {probability[limb, point]:.0%}"
            legend.append((LIMB_COLOURS[limb], words))
    return _marks(colours, legend, np.flatnonzero(probability.sum(axis=0) > 0.0).tolist())


def why_not(graph: StanceGraph, state: State, limb: int, point: int, steps: Successors) -> str:
    """Why a limb cannot step to the point of an index, one sentence; `""` if it can."""
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
    """Which of `REASONS` a sentence tells, `""` for none."""
    return next((kind for kind in REASONS if kind in sentence), "") if sentence else ""


def states_of(graph: StanceGraph, plan: Plan) -> tuple[State | None, ...]:
    """The states along a plan in the world as it is now, None from where it cannot be walked."""
    motion = plan.motion
    states: list[State | None] = []
    state: State | None = None
    for k, stance in enumerate(plan.stances):
        where = motion.base_positions[k], motion.base_quaternions[k]
        try:
            if k == 0:
                state = graph.state(stance, graph.given_pose_of(stance, *where))
            elif state is not None:
                state = graph.step_to(state, graph.indices(stance))
        except StanceError:
            state = None
        states.append(state)
    return tuple(states)


def nearest_to_ray(positions: Array, origin: Array, direction: Array) -> int:
    """Index of the point, of positions (k, 3) [m], that a line of sight comes closest to."""
    along = direction / np.linalg.norm(direction)
    away = positions - origin
    off = np.linalg.norm(away - (away @ along)[:, None] * along, axis=1)
    return int(np.argmin(np.where(away @ along > 0.0, off, np.inf)))


def _limbs_by_point(steps: Successors) -> dict[int, list[int]]:
    """The limbs that can step to each point."""
    found: dict[int, list[int]] = {}
    for limb, point in zip(steps.limb.tolist(), steps.point.tolist(), strict=True):
        found.setdefault(point, []).append(limb)
    return found


def _marks(
    colours: Sequence[str],
    legend: Sequence[tuple[str, str]],
    points: Sequence[int] = (),
) -> Marks:
    numbers = [[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in colours]
    return Marks(np.array(numbers), tuple(legend), tuple(points))
