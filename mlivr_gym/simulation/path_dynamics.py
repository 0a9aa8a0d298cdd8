"""What a piece of a step asks of the robot, for any clock.

With no gravity, torques and grasp wrenches at a share s of a piece are `a(s) s'' + b(s) s'^2`, and
speeds are `c(s) s'`: one pass of inverse dynamics over the piece gives all three. So at twice the
duration torques and wrenches fall to a quarter and speeds to a half, and how long a piece has to
take on a clock of given shape is one number. The rows are kept in units of their limits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from mlivr_gym.arrays import Array
from mlivr_gym.motion.path_segments import PathSegment
from mlivr_gym.motion.regrasp import PHASES, Regrasp
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.simulation.inverse_dynamics import needed
from mlivr_gym.simulation.limits import Limits

TIMES = 201
"""Times of a clock at which what it asks for is looked at."""


class Binding(NamedTuple):
    """The limit that decides how long a piece takes."""

    duration: float
    """Shortest duration of the piece [s]."""
    limit: str
    """`"torque"`, `"grasp_force"`, `"grasp_torque"`, `"speed"` or `"surface_speed"`, as in
    `Limits`."""
    limb: int
    """The limb concerned."""
    joint: int
    """Its joint, from 1 on; 0 where the limit is the gripper's."""

    @property
    def told(self) -> str:
        """Limit and joint in words."""
        where = f"joint {self.joint} of limb {self.limb}" if self.joint else f"limb {self.limb}"
        return f"{self.limit} of {where}"


class PieceRows(NamedTuple):
    """What a piece asks for at K shares, in units of the limits."""

    holding: tuple[int, ...]
    """Limbs that hold, n of them."""
    limb: int
    """The limb that moves."""
    shares: Array
    """Shape (K,)."""
    torques: Array
    """Of the joints, by s'' and by s'^2, shape (K, 2, 6 N)."""
    wrenches: Array
    """Forces and then torques of the grasps, by s'' and by s'^2, shape (K, 2, 2 n, 3)."""
    speeds: Array
    """Of the joints and of the gripper that departs or approaches, shape (K, 6 N + 1)."""

    def asked(self, clock: PPoly) -> tuple[Array, Array]:
        """What a clock asks for at `TIMES` times.

        Returns
        -------
        tuple[Array, Array]
            Torques, grasp forces and grasp torques in units of their limits, shape
            (TIMES, 6 N + 2 n), and speeds, shape (TIMES, 6 N + 1).
        """
        times = np.linspace(0.0, clock.x[-1], TIMES)
        share, rate, change = (clock(times, order) for order in range(3))
        count = len(self.shares)
        both = np.concatenate(
            [self.torques.reshape(count, -1), self.wrenches.reshape(count, -1), self.speeds], axis=1
        )
        found = CubicSpline(self.shares, both)(np.clip(share, 0.0, 1.0))
        joints, grasps = self.torques.shape[2], self.wrenches.shape[2]
        torques, wrenches, speeds = np.split(found, [2 * joints, 2 * joints + 6 * grasps], axis=1)
        factors = np.stack([change, rate**2], axis=1)
        torque = (factors[:, :, None] * torques.reshape(TIMES, 2, -1)).sum(axis=1)
        wrench = (factors[:, :, None] * wrenches.reshape(TIMES, 2, -1)).sum(axis=1)
        sizes = np.linalg.norm(wrench.reshape(TIMES, grasps, 3), axis=2)
        return np.column_stack([np.abs(torque), sizes]), np.abs(rate[:, None] * speeds)

    def binding(self, clock: PPoly) -> Binding:
        """The shortest duration of this piece on a clock of this shape, and what decides it."""
        loads, speeds = self.asked(clock)
        joints, duration = self.torques.shape[2], float(clock.x[-1])
        load, speed = loads.max(axis=0), speeds.max(axis=0)
        heaviest, fastest = int(np.argmax(load)), int(np.argmax(speed))
        if speed[fastest] > np.sqrt(load[heaviest]):
            limb, joint = divmod(fastest, 6)
            shortest = duration * float(speed[fastest])
            if fastest == joints:
                return Binding(shortest, "surface_speed", self.limb, 0)
            return Binding(shortest, "speed", limb, joint + 1)
        shortest = duration * float(np.sqrt(load[heaviest]))
        if heaviest < joints:
            limb, joint = divmod(heaviest, 6)
            return Binding(shortest, "torque", limb, joint + 1)
        kind, n = divmod(heaviest - joints, len(self.holding))
        return Binding(shortest, ("grasp_force", "grasp_torque")[kind], self.holding[n], 0)


def piece_rows(robot: RobotSpec, regrasp: Regrasp, piece: PathSegment, limits: Limits) -> PieceRows:
    """What a piece of a step asks for, in units of the limits.

    Raises
    ------
    RobotError
        If the robot's masses are not known, see `RobotSpec.limb_dynamics`.
    """
    shares, count = piece.shares, len(piece.shares)
    holding = tuple(i for i in range(robot.limbs) if i != regrasp.limb)
    positions = np.column_stack(
        [piece.base_positions, piece.base_quaternions, piece.joints.reshape(count, -1)]
    )
    first, second = piece.curve(shares, 1), piece.curve(shares, 2)
    still = np.zeros_like(first)
    asked = needed(robot, holding, positions, np.stack([still, first]), np.stack([first, second]))
    torque = limits.torque * robot.torque_limits.reshape(-1)
    speed = limits.speed * robot.speed_limits.reshape(-1)
    torques = asked.torques.swapaxes(0, 1).reshape(count, 2, -1) / torque
    wrenches = asked.wrenches.swapaxes(0, 1)
    forces = np.concatenate(
        [wrenches[..., :3] / limits.grasp_force, wrenches[..., 3:] / limits.grasp_torque], axis=2
    )
    # On departure and approach the gripper moves along the normal by the robot's lift.
    lifted = robot.lift / limits.surface_speed if PHASES[piece.phase] != "swing" else 0.0
    speeds = np.column_stack([first[:, 6:] / speed, np.full(count, lifted)])
    return PieceRows(holding, regrasp.limb, shares, torques, forces, speeds)
