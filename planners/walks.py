"""Walks: sequences of states that a method finds or a policy takes, and the plans they make."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.errors import StanceError
from mlivr_gym.kinematics.holding import quaternion
from mlivr_gym.motion.commitment import assemble
from mlivr_gym.motion.plan import Plan
from mlivr_gym.stances.lazy_graph import LazyGraph
from mlivr_gym.stances.stance_graph import StanceGraph, State, join

Array = NDArray[np.float64]


class Walk(NamedTuple):
    """What a method found.

    Attributes:
        states: K states, the first of them the start.
        reached: Whether the last one is at the goal.
        expanded: States whose steps were looked at.
    """

    states: tuple[State, ...]
    reached: bool
    expanded: int

    @property
    def actions(self) -> tuple[tuple[int, int], ...]:
        """Limb that moves and point it moves to, K - 1 pairs."""
        pairs = []
        for before, after in zip(self.states, self.states[1:], strict=False):
            limb = next(
                i
                for i, (a, b) in enumerate(zip(before.stance, after.stance, strict=True))
                if a != b
            )
            pairs.append((limb, after.stance[limb]))
        return tuple(pairs)


def plan_of(
    graph: StanceGraph,
    states: Sequence[State],
    goal: Array,
    tolerance: float,
    method: str,
    expanded: int = 0,
) -> Plan | None:
    """A plan that can be carried out from a sequence of states; None if a limb would leave its joint limits or finds no swing.

    Args:
        graph: The stance graph.
        states: The states, each a step from the one before it.
        goal: Goal position [m], shape (3,).
        tolerance: Radius of the goal region [m].
        method: Name of what found the states.
        expanded: States explored.
    """
    postures = graph.posture(states[0].stance)
    for state in states[1:]:
        postures = join(postures, graph.posture(state.stance))
    parts = assemble(graph, states, postures)
    if parts.beyond is not None:
        return None
    return Plan(
        stances=tuple(graph.ids(state.stance) for state in states),
        actions=tuple((step.limb, step.to_point) for step in parts.steps),
        steps=parts.steps,
        base_positions=postures.position,
        base_quaternions=np.array([quaternion(r) for r in postures.rotation]),
        joint_positions=parts.joints,
        branches=parts.branches,
        w_m=parts.w_m,
        w_b=parts.w_b,
        goal=(float(goal[0]), float(goal[1]), float(goal[2])),
        goal_tolerance=tolerance,
        cost_name="steps",
        cost=float(len(parts.steps)),
        regrasp_price=None,
        method=method,
        heuristic="none",
        expanded=expanded,
        generated=expanded,
        feasibility_time=0.0,
        search_time=0.0,
        map_name=graph.grasp_map.name,
        map_fingerprint=graph.grasp_map.fingerprint,
        obstacles=graph.obstacles,
        occupied=graph.ids(sorted(graph.occupied)),
        robot=graph.robot,
        settings=graph.settings,
    )


def executable_steps(graph: StanceGraph, stances: Sequence[Sequence[str | int]]) -> int:
    """How many steps of a sequence of stances can be carried out on a graph, from the first on."""
    points = [graph.indices(stance) for stance in stances]
    try:
        state = graph.state(points[0])
    except StanceError:
        return 0
    for done, after in enumerate(points[1:]):
        limb = next(i for i, (a, b) in enumerate(zip(state.stance, after, strict=True)) if a != b)
        if isinstance(graph, LazyGraph):
            both = join(graph.posture(state.stance), graph.posture(after))
            step = graph.transition(state, after, both) if graph.is_node(both).all() else None
            if step is None:
                return done
            state = State(after, step.masks)
            continue
        steps = graph.successors(state)
        found = np.flatnonzero((steps.limb == limb) & (steps.point == after[limb]))
        if not len(found):
            return done
        state = State(after, tuple(steps.masks[found[0]].tolist()))
    return len(points) - 1
