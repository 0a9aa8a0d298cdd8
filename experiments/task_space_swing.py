"""Swings in task space, as the paper writes, in place of those of a plan.

The gripper goes on a straight line from above the point it leaves to above the point it grasps, its
rotation by slerp; the joints follow by inverse kinematics on one branch. Base path and limbs that
hold are those of the plan, and so is the clock: one quintic over the whole swing. `attempts` tells
which branches can do so, `best` which of them is taken. A path gives a trajectory like that of any
step: `trajectory(path)`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array
from mlivr_gym.errors import PlanError
from mlivr_gym.kinematics.arm import LIMIT_TOLERANCE
from mlivr_gym.kinematics.limb import Angles, all_angles_at
from mlivr_gym.kinematics.path_following import joints_along, poses
from mlivr_gym.motion.regrasp import LARGEST_JUMP, UNCHECKED_KNOTS, Regrasp, RegraspPath
from mlivr_gym.motion.swings import SwingFinder
from mlivr_gym.stances.stance_graph import StanceGraph

BRANCHES = 8
"""Branches of a limb."""

SAMPLES = 401
"""Places along a swing at which it is looked at."""

OUTCOMES = ("free", "too close", "joint limit", "jump", "out of reach")
"""What comes of a swing in task space, the best first.

`free`: it keeps the clearance. `too close`: it can be followed, but comes closer to something.
`joint limit`: a joint leaves its limits. `jump`: a joint changes by more than `LARGEST_JUMP`
between two places, beside a singularity. `out of reach`: the branch ends on the line.
"""


@dataclass(frozen=True)
class Attempt:
    """A swing in task space on one branch.

    Attributes:
        branch: Branch of the limb that moves.
        half_turn: Whether it grasps the point half a turn away from how the map has it.
        turn: By how much the gripper turns on the line [rad].
        outcome: One of `OUTCOMES`.
        path: The step, if it can be followed.
    """

    branch: int
    half_turn: bool
    turn: float
    outcome: str
    path: TaskSpacePath | None

    @property
    def followed(self) -> bool:
        """Whether the limb can follow it inside its limits."""
        return self.path is not None


@dataclass(frozen=True)
class GripperLine:
    """Where the gripper is in a swing in task space.

    Attributes:
        positions: Grasp point at both ends, shape (2, 3) [m].
        start: Rotation of the flange at the start.
        turn: Rotation vector to the end, in the frame of the flange, shape (3,) [rad].
    """

    positions: Array
    start: Rotation
    turn: Array

    @classmethod
    def of(cls, graph: StanceGraph, regrasp: Regrasp, *, half_turn: bool) -> GripperLine:
        """The line of a step, to either of the two ways round in which a gripper grasps."""
        rows = graph.solver.grasps[[regrasp.before[regrasp.limb], regrasp.to_point]]
        above = rows["point"] + graph.robot.lift * rows["normal"]
        tools = Rotation.from_matrix(rows["flange"]["rotation"])
        end = tools[1] * Rotation.from_rotvec([0.0, 0.0, np.pi * half_turn])
        return cls(above, tools[0], (tools[0].inv() * end).as_rotvec())

    def flanges(self, share: Array, tool_length: float) -> tuple[Array, Array]:
        """Flange positions (k, 3) [m] and rotations (k, 3, 3) at shares of the line."""
        rotations = (self.start * Rotation.from_rotvec(share[:, None] * self.turn)).as_matrix()
        grasps = self.positions[0] + share[:, None] * (self.positions[1] - self.positions[0])
        return grasps - tool_length * rotations[:, :, 2], rotations


class TaskSpacePath(RegraspPath):
    """A step of a plan with its gripper on a line, on a branch of its choice."""

    def __init__(
        self, graph: StanceGraph, regrasp: Regrasp, grasped: Array, line: GripperLine
    ) -> None:
        """Swing on `line`, from joint angles `grasped` on the branch of `regrasp`, shape (6,).

        Raises:
            PlanError: If the branch ends on the way.
        """
        joints = regrasp.joints.copy()
        joints[regrasp.limb] = grasped
        bare = replace(regrasp, joints=joints, knots=UNCHECKED_KNOTS, rounded=np.zeros((0, 2)))
        super().__init__(graph, bare)
        self.line, self.branch = line, regrasp.branches[regrasp.limb]
        self._above = self.departure(np.array([0.0, 1.0]))[1]
        end = self.swing(0, np.linspace(0.0, 1.0, SAMPLES))[1][-1]
        grasp = graph.solver.grasps[regrasp.to_point]
        heights = np.linspace(graph.robot.lift, 0.0, SAMPLES)
        flange = grasp["flange"]["position"] + heights[:, None] * grasp["normal"]
        tool, still = grasp["flange"]["rotation"][None], self.base(np.ones(1))
        down = follow(self, self.branch, (flange, tool), still, end)
        self.regrasp = replace(self.regrasp, grasp_joints=down[-1])

    @property
    def pieces(self) -> int:
        """One: the gripper does not stop on the line."""
        return 1

    def swing(self, piece: int, share: Array) -> tuple[Array, Array]:
        """Base parameter and joint angles at shares of the line that start at 0 or are all later.

        The angles are followed from the start of the line, however far off the first share is.
        """
        run_up = np.linspace(0.0, float(share[0]), SAMPLES)[:-1] if share[0] > 0.0 else share[:0]
        places = np.concatenate([run_up, share])
        flanges = self.line.flanges(places, self.graph.robot.tool_length)
        joints = follow(self, self.branch, flanges, self.base(places), self._above)
        return share, joints[len(run_up) :]


def follow(
    path: RegraspPath,
    branch: int,
    flanges: tuple[Array, Array],
    base: tuple[Array, Array],
    start: Array,
) -> Array:
    """Joint angles of the limb that moves at flange and base poses, shape (k, 6) [rad].

    Args:
        path: The step.
        branch: Branch on which the limb stays.
        flanges: Positions and rotations of the flange, k or one of each.
        base: Positions and rotations of the base, k or one of each.
        start: Joint angles close to those at the first, shape (6,) [rad].

    Raises:
        PlanError: If the branch ends on the way.
    """
    step, (bases, rows) = path.regrasp, (poses(*base), poses(*flanges))
    out, reference = Angles.rows(max(len(bases), len(rows))), Angles.row()
    reference["q"] = start
    robots = path.graph.checks.robots
    if joints_along(robots, step.limb, bases, rows, branch, reference, out) < len(out):
        raise PlanError(f"limb {step.limb} cannot follow the line on branch {branch}")
    joints: Array = out["q"]
    return joints


def attempts(graph: StanceGraph, regrasp: Regrasp) -> list[Attempt]:
    """Every swing in task space of a step: on each branch, to both ways round of its grasp.

    Args:
        graph: The stance graph, which says what stands round the robot.
        regrasp: The step of a plan.
    """
    found = []
    for branch, grasped in _starts(graph, regrasp):
        ends = (*regrasp.branches[: regrasp.limb], branch, *regrasp.branches[regrasp.limb + 1 :])
        step = replace(regrasp, branches=(*ends[:-1], branch))
        for half_turn in (False, True):
            line = GripperLine.of(graph, step, half_turn=half_turn)
            turn = float(np.linalg.norm(line.turn))
            try:
                path = TaskSpacePath(graph, step, grasped, line)
            except PlanError:
                found.append(Attempt(branch, half_turn, turn, "out of reach", None))
                continue
            outcome = _outcome(path)
            kept = path if outcome in OUTCOMES[:2] else None
            found.append(Attempt(branch, half_turn, turn, outcome, kept))
    return found


def _starts(graph: StanceGraph, regrasp: Regrasp) -> Iterator[tuple[int, Array]]:
    """Each branch on which the limb can hold the point it leaves, with its joint angles."""
    limb, grasp = regrasp.limb, graph.solver.grasps[regrasp.before[regrasp.limb]]
    base, angles = regrasp.base_path["first"], Angles.rows(BRANCHES)
    all_angles_at(graph.checks.robots, limb, base, grasp["flange"], angles)
    for branch in range(BRANCHES):
        if branch == regrasp.branches[limb]:
            yield branch, regrasp.joints[limb]
        elif not np.isnan(angles["q"][branch]).any():
            yield branch, angles["q"][branch].copy()


def _outcome(path: TaskSpacePath) -> str:
    """What comes of a swing whose branch does not end."""
    share = np.linspace(0.0, 1.0, SAMPLES)
    _, joints = path.swing(0, share)
    whole = np.concatenate([path.departure(share), joints, path.approach(share)])
    limits = path.graph.robot.limb.limits
    if np.maximum(limits[:, 0] - whole, whole - limits[:, 1]).max() > LIMIT_TOLERANCE:
        return "joint limit"
    if np.abs(np.diff(whole, axis=0)).max() > LARGEST_JUMP:
        return "jump"
    finder = SwingFinder.of(path.graph, path.regrasp)
    return "free" if finder.clear(np.column_stack([share, joints])[::2]) else "too close"


def best(found: Sequence[Attempt], branch: int) -> Attempt:
    """The attempt with the best outcome; of equal ones that on `branch`, then the least turn."""
    return min(
        found,
        key=lambda attempt: (
            OUTCOMES.index(attempt.outcome),
            attempt.branch != branch,
            round(attempt.turn, 6),
            attempt.branch,
        ),
    )
