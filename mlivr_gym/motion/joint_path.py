"""Joint paths: the motion of one step, as it is stored, executed, exported and drawn.

**Path.** A joint path is a sequence of *knots*, each the joint angles of all limbs, the control
points of the spline on which all of them move, see Timing; between two rests with no knot in
between it is a line. The base is no variable of its own: one support limb, the
*leader*, carries it. The leader's grasp rests in the world, so that the base is at
`grasp * FK(q_leader)^-1`. The base pose at the first knot says where the grasp is. Nothing else is
needed to follow a joint path: neither the map nor inverse kinematics.

**Rests.** The robot is at rest at the first and the last knot, after the departure, before the
approach, and at the corners of the swing between them. Between two rests lies a path segment.

**Where knots come from.** `commitment` chooses branches and swing of a step on an edge of the
stance graph. `straight_base` takes knots from curves that were checked, and steps that are not
checked move as in the paper, `paper_motion`. Above its points the gripper follows the surface
normal, see `step_ends`.

**Timing.** A segment is passed smoothly from rest to rest, with a time scaling sigma(t) of its path
parameter from 0 to 1. Between two knots alone it is their line. Otherwise it is the uniform cubic
B-spline whose control points are the knots, with ends that are clamped to the first and the last:
accelerations do not jump, and since each of its points is a weighted mean of four knots in turn,
no joint goes farther than the knots do. It passes a knot at a sixth of the second difference there.
The base follows from the leader, so that the leader's gripper stays where it is; grippers of other
support limbs are off their grasps by at most `HOLD_TOLERANCE`.

**Who reads it.** `Plan.joint_path` gives the joint path of a step. From it follow configurations of
figures and films (`samples`), trajectories and their exports (`trajectory`), dynamics and time
scalings of the simulation (`segments`), and the checks of a file that is read (`plan_checks`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.specification import RobotSpec

PHASES = ("departure", "swing", "approach")
"""Names of the phases of a step, in their order."""

SAMPLES = 96
"""Least number of intervals of a path segment at whose ends its dynamics are computed."""

CUBIC = 3
"""Degree of the spline of a segment with four knots and more."""

HOLD_TOLERANCE = 2e-4
"""Largest slip of a support limb [m]; half of it is aimed at on lines between knots, since their
spline slips by up to 4 / 3 of that."""

GRIP_RADIUS = 0.1
"""Size of a gripper, by which a turn of it counts as slip [m]."""


@dataclass(frozen=True)
class StepMotion:
    """k configurations along one step."""

    phase: IntArray
    """Index into `PHASES`, shape (k,)."""
    base_positions: Array
    """Base positions in the world, shape (k, 3) [m]."""
    base_quaternions: Array
    """Base orientations in the world w, x, y, z, shape (k, 4)."""
    joint_positions: Array
    """Joint angles, shape (k, N, 6) [rad]."""


@dataclass(frozen=True)
class JointPath:
    """The motion of one step: knots, the control points of a spline, and the limb that leads."""

    robot: RobotSpec
    """The robot."""
    limb: int
    """Index of the limb that moves."""
    leader: int
    """Index of the support limb that carries the base."""
    base_position: Array
    """Base position in the world at the first knot, shape (3,) [m]."""
    base_rotation: Array
    """Base rotation in the world at the first knot, shape (3, 3)."""
    knots: Array
    """Joint angles of all limbs at the knots, shape (k, N, 6) [rad]."""
    rests: tuple[int, ...]
    """Indices of the knots at which the robot is at rest, from 0 to k - 1."""

    @property
    def supports(self) -> tuple[int, ...]:
        """Indices of the support limbs."""
        return tuple(limb for limb in range(self.robot.limbs) if limb != self.limb)

    def base(self, joints: Array) -> tuple[Array, Array]:
        """Return base positions (k, 3) [m] and rotations (k, 3, 3) at joint angles (k, N, 6)."""
        held, turn = self._held[self.leader]
        places, turns = flange_in_body(self.robot, self.leader, joints[:, self.leader])
        rotations = turn @ turns.swapaxes(1, 2)
        return held - (rotations @ places[..., None])[..., 0], rotations

    @cached_property
    def _held(self) -> dict[int, tuple[Array, Array]]:
        """Position [m] and rotation in the world of each support limb's flange."""
        held = {}
        for limb in self.supports:
            place, turn = flange_in_body(self.robot, limb, self.knots[0, limb])
            held[limb] = self.base_position + self.base_rotation @ place, self.base_rotation @ turn
        return held

    def slips(self, joints: Array) -> Array:
        """Return how far support limbs are from their grasps at joint angles (k, N, 6), (k,) [m].

        It is the largest displacement of a gripper from where it is at the first knot, with its
        angle times `GRIP_RADIUS`. The leader does not slip.
        """
        slips: Array = np.zeros(len(joints))
        followers = [limb for limb in self.supports if limb != self.leader]
        positions, rotations = self.base(joints) if followers else (slips, slips)
        for limb in followers:
            held, turn = self._held[limb]
            places, turns = flange_in_body(self.robot, limb, joints[:, limb])
            moved = positions - held + (rotations @ places[..., None])[..., 0]
            turned = rotations @ turns - turn
            moved += self.robot.tool_length * turned[..., 2]
            angles = np.linalg.norm(turned, axis=(1, 2)) / np.sqrt(2.0)
            slips = np.maximum(slips, np.linalg.norm(moved, axis=1) + GRIP_RADIUS * angles)
        return slips

    @cached_property
    def segments(self) -> tuple[PathSegment, ...]:
        """The path segments in their order."""
        phases = [0, *[1] * (len(self.rests) - 3), 2]
        return tuple(
            PathSegment.of(self, phase, self.knots[first : last + 1])
            for phase, (first, last) in zip(phases, pairwise(self.rests), strict=True)
        )

    @property
    def sigmas(self) -> Array:
        """Path parameter of each knot, shape (k,); a whole number where the robot is at rest."""
        places = [
            n + control_places(b - a + 1)[:-1] for n, (a, b) in enumerate(pairwise(self.rests))
        ]
        return np.concatenate([*places, [len(places)]])

    def samples(self, count: int) -> StepMotion:
        """Return `count` configurations on each segment, evenly spaced over the path parameter."""
        sigma = np.linspace(0.0, 1.0, count)
        joints = np.concatenate([segment.joints_at(sigma) for segment in self.segments])
        phases = np.repeat([segment.phase for segment in self.segments], count)
        positions, rotations = self.base(joints)
        return StepMotion(phases, positions, quaternions(rotations), joints)

    @property
    def base_chord(self) -> float:
        """Distance of the base at the last knot from the base at the first [m]."""
        return float(np.linalg.norm(np.diff(self.base(self.knots[[0, -1]])[0], axis=0)))

    @property
    def base_length(self) -> float:
        """Length of the base path, at least the chord [m]."""
        places = np.concatenate([segment.base_positions for segment in self.segments])
        return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


@dataclass(frozen=True)
class PathSegment:
    """Part of a joint path from rest to rest, sampled at K values of its own path parameter.

    The derivatives of the base are its linear velocity in the world frame and its angular velocity
    in the body frame, the convention of MuJoCo's free joint.
    """

    phase: int
    """Index into `PHASES`."""
    sigmas: Array
    """Path parameter at the samples, from 0 to 1, shape (K,)."""
    base_positions: Array
    """Base positions in the world, shape (K, 3) [m]."""
    base_quaternions: Array
    """Base orientations in the world w, x, y, z, shape (K, 4)."""
    joints: Array
    """Joint angles, shape (K, N, 6) [rad]."""
    curve: scipy.interpolate.CubicSpline
    """Cubic spline of base position, accumulated base rotation and joint angles; its derivatives by
    sigma have shape (k, 6 + 6 N) [m, rad]."""

    @classmethod
    def of(cls, path: JointPath, phase: int, knots: Array) -> PathSegment:
        """Return the segment of a joint path with given knots, shape (k, N, 6) [rad].

        Samples of the base rotation are close, so that it is the sum of small rotation vectors in
        the body frame.
        """
        degree = min(CUBIC, len(knots) - 1)
        breaks = spline_breaks(len(knots))
        through = scipy.interpolate.BSpline(breaks, knots.reshape(len(knots), -1), degree)
        # Samples at all breakpoints, and between them, so that the cubic spline is the same.
        pieces = len(knots) - degree
        sigmas = np.linspace(0.0, 1.0, pieces * max(2, -(-SAMPLES // pieces)) + 1)
        joints = through(sigmas)
        positions, rotations = path.base(joints.reshape(-1, *knots.shape[1:]))
        turned = scipy.spatial.transform.Rotation.from_matrix(rotations)
        turns = (turned[:-1].inv() * turned[1:]).as_rotvec()
        angles = np.concatenate([np.zeros((1, 3)), np.cumsum(turns, axis=0)])
        every = np.column_stack([positions, angles, joints])
        return cls(
            phase,
            sigmas,
            positions,
            turned.as_quat(scalar_first=True),
            joints.reshape(-1, *knots.shape[1:]),
            scipy.interpolate.CubicSpline(sigmas, every),
        )

    def joints_at(self, sigma: Array) -> Array:
        """Return joint angles at k values of the path parameter, shape (k, N, 6) [rad]."""
        joints: Array = self.curve(sigma)[:, 6:]
        return joints.reshape(-1, *self.joints.shape[1:])

    @property
    def travel(self) -> float:
        """Largest travel of any joint along the segment [rad]."""
        return float(np.abs(np.diff(self.joints, axis=0)).sum(axis=0).max())


def spline_breaks(count: int) -> Array:
    """Return the knot vector of the clamped uniform spline with `count` control points."""
    degree = min(CUBIC, count - 1)
    return np.pad(np.linspace(0.0, 1.0, count - degree + 1), degree, mode="edge")


def control_places(count: int) -> Array:
    """Return the path parameters of the control points of a segment, shape (count,), from 0 to 1.

    They are its Greville abscissae: from control points on a line at these places follows a motion
    at constant rate.
    """
    degree, breaks = min(CUBIC, count - 1), spline_breaks(count)
    places: Array = np.mean([breaks[1 + k : 1 + k + count] for k in range(degree)], axis=0)
    return places


def flange_in_body(robot: RobotSpec, limb: int, joints: Array) -> tuple[Array, Array]:
    """Return where a limb's flange is in the body frame at joint angles (..., 6) [rad].

    Positions have shape (..., 3) [m], rotations shape (..., 3, 3).
    """
    frames = link_frames(robot.every_limb[limb], joints)[..., 6, :, :]
    mount = robot.mount_rotations[limb]
    positions: Array = robot.mount_positions[limb] + frames[..., :3, 3] @ mount.T
    return positions, mount @ frames[..., :3, :3]


def quaternions(rotations: Array) -> Array:
    """Return continuous quaternions w, x, y, z of rotations (k, 3, 3); the first has w >= 0."""
    quaternions: Array = scipy.spatial.transform.Rotation.from_matrix(rotations).as_quat(
        scalar_first=True
    )
    same = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]) >= 0.0
    signs = np.cumprod(np.concatenate([[quaternions[0, 0] >= 0.0], same]) * 2.0 - 1.0)
    return quaternions * signs[:, None]
