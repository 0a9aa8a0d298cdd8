"""Where robots of which joints have failed go on from, and their plans."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from itertools import islice, product

from mlivr_gym.arrays import Array
from mlivr_gym.compiled.bit_sets import bits_of
from mlivr_gym.errors import SettingError, StanceError
from mlivr_gym.planners.failed_joints import (
    FailedJoint,
    Start,
    robot_with_failed_joints,
    spare_and_folded,
    start_with_failed_joints,
)
from mlivr_gym.planners.folded_limb import folded_limb
from mlivr_gym.planners.planning_result import (
    START_INFEASIBLE,
    PlanningResult,
    Timer,
    without_plan,
)
from mlivr_gym.postures.given_pose import JOINT_TOLERANCE, given_joints
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.stances.build import in_same_world
from mlivr_gym.stances.stance_graph import StanceGraph
from mlivr_gym.transitions.state import State

MOST_STARTS = 32
"""Number of combinations of branches of which a start is made where a limb must fold."""


def plan_with_failed_joints(
    graph: StanceGraph,
    failed: Sequence[FailedJoint],
    start: Start,
    plan: Callable[[StanceGraph, Start, float | None], PlanningResult],
    time_limit: float | None,
) -> PlanningResult:
    """Return the first plan of the robot that results, or why there is none.

    `plan` plans on a graph from a start in a time [s], None for no limit. All starts share the time
    limit [s]. Raises as `starts_with_failed_joints`, but for a start that is not possible, which
    the result tells.
    """
    timer, began = Timer(), time.perf_counter()
    try:
        for results_in, given in starts_with_failed_joints(graph, failed, start):
            spent = time.perf_counter() - began
            remaining = None if time_limit is None else max(time_limit - spent, 0.0)
            result = plan(results_in, given, remaining)
            if result.plan is not None or remaining == 0.0:
                break
    except StanceError as error:
        return without_plan(START_INFEASIBLE, str(error), timer)
    return result


def starts_with_failed_joints(
    graph: StanceGraph, failed: Sequence[FailedJoint], start: Start
) -> Iterator[tuple[StanceGraph, Start]]:
    """Yield the graph of the robot that results, and starts of the whole robot in its terms.

    Other joints, or other limbs, move in that robot. There is more than one start if a limb folds
    and the branches of the others are free. Raises a `SettingError` if a joint that has failed is
    not at its angle at the start, and a `StanceError` if a limb that must fold cannot.
    """
    spare, folded = spare_and_folded(graph.robot, failed)
    if spare:
        robot = robot_with_failed_joints(graph.robot, spare)
        start = start_with_failed_joints(graph, robot, spare, start)
        graph = in_same_world(graph, robot=robot)
    points, pose, joints = start
    if folded is None or (isinstance(points, State) and not (pose is None and joints is None)):
        yield graph, start  # the latter is refused as without failed joints
        return
    state = graph.state(points, pose, joints) if not isinstance(points, State) else points
    given = None if joints is None else given_joints(graph.robot, joints)
    yield from _starts_with_folded_limb(graph, graph.validated_state(state), given, folded)


def _starts_with_folded_limb(
    graph: StanceGraph, state: State, given: Array | None, failed: FailedJoint
) -> Iterator[tuple[StanceGraph, Start]]:
    """Yield the graph of the limbs that do not fold, and starts on branches of a state.

    Start joints (N, 6) may be given [rad].
    """
    limb, joint, angle = failed
    others = [i for i in range(graph.robot.limbs) if i != limb]
    ids = [graph.ids(state.stance)[i] for i in others]
    graphs, fault = dict[RobotSpec, StanceGraph](), None
    for on_branches in islice(_on_each_branch(graph, state, failed), MOST_STARTS):
        _, quaternion, joints = graph.configuration(on_branches)
        joints = joints if given is None else given.copy()
        joints[limb, joint - 1] = angle
        try:
            folded = folded_limb(graph, on_branches, joints, limb, (joint, angle))
        except StanceError as error:
            fault = fault or error
            continue
        if folded.robot not in graphs:
            graphs[folded.robot] = in_same_world(graph, robot=folded.robot)
        pose = (*folded.positions[-1].tolist(), *quaternion.tolist())
        yield graphs[folded.robot], (ids, pose, folded.joints[-1, others])
    if fault is not None and not graphs:
        raise fault


def _on_each_branch(graph: StanceGraph, state: State, failed: FailedJoint) -> Iterator[State]:
    """Yield a state on each of its branches on which the failed joint is at its angle."""
    limb, joint, angle = failed
    free = [_branches(one) for one in state.branch_sets]
    there = {}
    for bit in bits_of(state.branch_sets[limb]):
        sets = (*state.branch_sets[:limb], 1 << bit, *state.branch_sets[limb + 1 :])
        at_bit = graph.configuration(state._replace(branch_sets=sets))[2]
        there[bit] = float(at_bit[limb, joint - 1])
    free[limb] = [bit for bit, q in there.items() if abs(q - angle) <= JOINT_TOLERANCE]
    if not free[limb]:
        listed = ", ".join(sorted({f"{q:.4f}" for q in there.values()}))
        raise SettingError(
            f"failed_joints: joint {joint} of limb {limb} is at {listed} rad at the start, not at "
            f"{angle:.4f} rad"
        )
    for bits in product(*free):
        yield state._replace(branch_sets=tuple(1 << bit for bit in bits))


def _branches(branch_set: int) -> list[int]:
    """Return the branches of a branch set, each with the first of its flips."""
    return list({bit & 7: bit for bit in reversed(bits_of(branch_set))}.values())[::-1]
