"""What the robot does between the stances of a plan, as configurations without a clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mlivr_gym.base_path import PATH_KINDS, STRAIGHT, follow
from mlivr_gym.errors import PlanError
from mlivr_gym.planners.plan import Plan
from mlivr_gym.stance_graph import StanceGraph
from mlivr_gym.transitions import base_path, quaternion

Array = NDArray[np.float64]

PHASES = ("departure", "swing", "approach")
"""Parts of a step."""


@dataclass(frozen=True)
class StepMotion:
    """Configurations along one step, k in all.

    Attributes:
        phase: Index into `PHASES`, shape (k,).
        base_positions: Shape (k, 3) [m].
        base_quaternions: Shape (k, 4), w, x, y, z.
        joint_positions: Shape (k, N, 6) [rad].
    """

    phase: NDArray[np.int64]
    base_positions: Array
    base_quaternions: Array
    joint_positions: Array


def step_motion(graph: StanceGraph, plan: Plan, index: int, samples: int = 50) -> StepMotion:
    """Configurations along one step of a plan that was made with collisions checked.

    The limb that moves departs along the surface normal, follows the knots of its swing while the base follows its path,
    and approaches along the other normal; the limbs that hold follow the base on their branches.

    Args:
        graph: The stance graph of the plan's robot and map.
        plan: The plan.
        index: Index of the step.
        samples: Configurations on the departure, on the approach, and between two knots of the swing.

    Raises:
        PlanError: If the step carries no swing.
    """
    step = plan.steps[index]
    if not step.knots:
        raise PlanError(f"step {index} carries no swing; make the plan with collisions=True")
    limb, limbs = step.limb, graph.limbs
    before, after = (graph.indices(plan.stances[k]) for k in (index, index + 1))
    rotations = [_matrix(plan.base_quaternions[k]) for k in (index, index + 1)]
    positions = plan.base_positions[index], plan.base_positions[index + 1]
    knots = np.array(step.knots)
    phase, us, own = [], [], []
    rise = np.linspace(0.0, 1.0, samples)
    for s in rise:
        phase.append(0)
        us.append(0.0)
        own.append(_above(graph, before[limb], limb, plan, index, s, positions[0], rotations[0]))
    for a, b in zip(knots, knots[1:], strict=False):
        for s in rise:
            phase.append(1)
            us.append(float(a[0] + s * (b[0] - a[0])))
            own.append(a[1:] + s * (b[1:] - a[1:]))
    for s in rise[::-1]:
        phase.append(2)
        us.append(1.0)
        own.append(_above(graph, after[limb], limb, plan, index + 1, s, positions[1], rotations[1]))
    kind, pivot = PATH_KINDS.index(step.path), np.array(step.pivot)
    where, turned = base_path(positions[0], rotations[0], positions[1], rotations[1], kind, pivot, np.array(us))
    joints = np.empty((len(us), limbs, 6))
    joints[:, limb] = own
    for other in range(limbs):
        if other == limb:
            continue
        q, flip = plan.joint_positions[index, other].copy(), _flip(graph, before[other], other, plan, index)
        q[5] -= np.pi * flip
        for k in range(len(us)):
            here = (where[k], turned[k])
            _follow(graph, before[other], other, plan, index, *here, q)
            joints[k, other] = q
        joints[:, other, 5] += np.pi * flip
    quaternions = np.array([quaternion(rotation) for rotation in turned])
    return StepMotion(np.array(phase), where, quaternions, joints)


def _matrix(quaternion: Array) -> Array:
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _follow(
    graph: StanceGraph, point: int, limb: int, plan: Plan, index: int, position: Array, rotation: Array, q: Array
) -> None:
    """Move `q` to the angles at which a limb grasps a point, flip 0, with the base at a pose."""
    solver = graph.solver
    here = (np.ascontiguousarray(position), np.ascontiguousarray(rotation))
    found = follow(
        graph.grips[point], solver.tools[point], *here, *here, STRAIGHT, here[0], solver.mount_rotations[limb],
        solver.mount_positions[limb], solver.lengths, int(plan.branches[index, limb]), 0, np.empty(6), q, np.full(6, np.inf),
        np.full(6, -np.inf),
    )  # fmt: skip
    if not found:
        raise PlanError(f"limb {limb} cannot follow step {index}: the plan does not fit this map and robot")


def _flip(graph: StanceGraph, point: int, limb: int, plan: Plan, index: int) -> int:
    """Whether a limb grasps with the tool turned by half a turn."""
    q = plan.joint_positions[index, limb].copy()
    _follow(graph, point, limb, plan, index, plan.base_positions[index], _matrix(plan.base_quaternions[index]), q)
    return int(np.rint(abs(plan.joint_positions[index, limb, 5] - q[5]) / np.pi)) % 2


def _above(
    graph: StanceGraph, point: int, limb: int, plan: Plan, index: int, share: float, position: Array, rotation: Array
) -> Array:
    """Angles of a limb that has departed from its point by a share of the lift."""
    q, flip = plan.joint_positions[index, limb].copy(), _flip(graph, point, limb, plan, index)
    q[5] -= np.pi * flip
    lowered = position - share * graph.robot.lift * graph.solver.normals[point]
    _follow(graph, point, limb, plan, index, lowered, rotation, q)
    q[5] += np.pi * flip
    return q
