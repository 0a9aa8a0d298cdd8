"""The fields of a robot, and their checks one by one."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any

import numpy as np

from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import GivenCapsules
from mlivr_gym.robot.cargo import CARGO, Cargo
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.limb_dynamics import GIVEN_LIMB, GivenDynamics
from mlivr_gym.robot.mounts import MOUNT, Mount
from mlivr_gym.robot.planning_lengths import CHARACTERISTIC_LENGTH, HEIGHTS, SPAN, geometric_order
from mlivr_gym.robot.sizes import MOST_LIMBS
from mlivr_gym.robot.validators import (
    APART,
    EDGES,
    FARTHEST_TURN,
    LENGTH,
    MASSES,
    MOST_FOLDS,
    MOST_POSES,
    POSITION,
    POSITIVE,
    GivenInertia,
    PairOf,
)
from mlivr_gym.robot.visuals import GivenVisuals
from mlivr_gym.schema import NAME, FieldPath, Integer, ListOf, OrNone, Struct, Text, Tuples
from mlivr_gym.values import MAX_REMARK_LENGTH, MAX_ROBOT_LENGTH, Triple

FOLDS_OF_LIMB: tuple[tuple[float, ...], ...] = ((),)
"""Stands for `Limb.default_folds`."""

PHYSICAL = ("dynamics", "body_centre", "body_inertia", "source", "visuals", "joint_names")
"""Fields of a robot on which no plan depends."""

SPARSE = ("visuals", "cargo", "joint_names")
"""Fields of robots, and of their parts, that plain data name only where there are any."""


@dataclass(frozen=True)
class RobotFields:
    """The fields of a `RobotSpec`."""

    name: Annotated[str, NAME] = "robot"
    """Short name."""
    limbs: Annotated[int, Integer(2, MOST_LIMBS)] = 2
    """Number of limbs N, at least 2; with `mounts` it is their number."""
    limb: Annotated[Limb, GIVEN_LIMB] = field(default_factory=Limb)
    """Kinematics of one limb."""
    mount_radius: Annotated[float, LENGTH] = 0.1
    """Distance of a limb's base from the body's z axis [m]."""
    tool_length: Annotated[float, LENGTH] = 0.05
    """Distance from the flange to the grasp along the flange normal [m]."""
    characteristic_length: Annotated[float, POSITIVE] = CHARACTERISTIC_LENGTH
    """l_c, which makes lengths and angles comparable in the Jacobian [m]."""
    grasp_separation: Annotated[float, LENGTH] = 0.1
    """Smallest distance of two points held at once [m] (gripper width)."""
    span: Annotated[float, POSITIVE] = SPAN
    """Largest distance of two points that a stance may hold [m]."""
    heights: Annotated[
        tuple[float, ...],
        Tuples((None,), -MAX_ROBOT_LENGTH, MAX_ROBOT_LENGTH, "m", (1, MOST_POSES)),
    ] = HEIGHTS
    """Candidate heights of the base over the grasps' centroid [m], in any order; they are stored
    lowest first."""
    rolls: Annotated[
        tuple[float, ...], Tuples((None,), -FARTHEST_TURN, FARTHEST_TURN, "rad", (1, MOST_POSES))
    ] = tuple(np.deg2rad([0.0, -15.0, 15.0, -30.0, 30.0]).tolist())
    """Candidate rolls about the line from the grasps' centroid to that of limb 0, with more than
    two limbs to the nearest grasp [rad], in any order; stored in `geometric_order`."""
    lift: Annotated[float, LENGTH] = 0.1
    """Distance by which a gripper departs along the surface normal before it swings [m]."""
    folds: Annotated[
        tuple[tuple[float, ...], ...],
        Tuples((None, 5), -FARTHEST_TURN, FARTHEST_TURN, "rad", (1, MOST_FOLDS)),
    ] = FOLDS_OF_LIMB
    """Angles of joints 1 to 5 [rad] at which a free limb may stay folded while the base moves, at
    most four, the preferred first; those outside the windows of the joints are left out. By default
    `default_folds` of the limb."""
    capsules: GivenCapsules = None
    """Collision shapes of a limb; by default those of the UR5e, or of
    another arm simple ones along its links, and a gripper from the flange to the grasp."""
    body_size: Annotated[float | Triple, EDGES] = 0.2
    """Edge of the body, a cube, or its three edges along x, y and z [m]."""
    body_mass: Annotated[float, Tuples((), *MASSES, "kg")] = 20.0
    """Mass of the body [kg]."""
    gripper_mass: Annotated[float, Tuples((), 0.0, MASSES[1], "kg")] = 0.5
    """Mass of a gripper [kg]; 0 if the last link of the limb includes it."""
    dynamics: GivenDynamics = None
    """Masses, inertias, and limits of torque and speed of a limb, or the name of one of `ARMS`;
    None for those of the arm that has the limb's lengths."""
    mounts: Annotated[tuple[Mount, ...] | None, OrNone(ListOf(MOUNT, 2, MOST_LIMBS))] = None
    """Place of each limb, and its own kinematics if limbs differ; None for equal limbs at equal
    angles, see `mlivr_gym.robot.mounts.Mount`."""
    apart: Annotated[tuple[tuple[str, str], ...], ListOf(PairOf(APART), 0, len(APART))] = ()
    """Pairs of links of one limb, of `APART`, whose true shapes never meet although their capsules
    may: these pairs are not compared."""
    body_centre: Annotated[Triple, POSITION] = (0.0, 0.0, 0.0)
    """Centre of mass of the body in its frame [m]."""
    body_inertia: GivenInertia = None
    """Inertia about that centre, xx, yy, zz, xy, xz, yz [kg m^2]; None for that of a box."""
    source: Annotated[str, Text(0, MAX_REMARK_LENGTH)] = ""
    """Where the figures come from, for readers."""
    visuals: GivenVisuals = None
    """Meshes that show a limb in pictures; None for those that ship, or for its capsules."""
    cargo: Annotated[Cargo | None, OrNone(CARGO)] = None
    """Load that is fixed to the body; None for none."""
    joint_names: Annotated[
        tuple[tuple[str, ...], ...] | None, OrNone(ListOf(ListOf(NAME, 6, 6), 2, MOST_LIMBS))
    ] = None
    """Names of the joints of each limb that move, six of them; None for `named_joints`."""

    def __post_init__(self) -> None:
        """Check every figure."""
        if self.folds is FOLDS_OF_LIMB:
            limb = ROBOT_FIELDS.validators["limb"].read(self.limb, FieldPath("limb", RobotError))
            object.__setattr__(self, "folds", limb.default_folds)
        if self.mounts is not None and isinstance(self.mounts, list | tuple):
            object.__setattr__(self, "limbs", len(self.mounts))
        ROBOT_FIELDS.check(self, FieldPath("", RobotError))
        object.__setattr__(self, "heights", tuple(sorted(self.heights)))
        object.__setattr__(self, "rolls", geometric_order(self.rolls))
        names = [name for limb in self.joint_names or () for name in limb]
        if len(names) not in (0, 6 * self.limbs):
            raise RobotError(f"joint_names is of {len(names) // 6} limbs; it has {self.limbs}")
        for k, name in enumerate(names):
            if name in names[:k]:
                raise RobotError(f"joint_names has {name!r} twice; names must differ")
        if self.span <= self.grasp_separation:
            raise RobotError(
                f"span is {self.span!r}; it must exceed grasp_separation {self.grasp_separation!r}"
            )

    @property
    def fingerprint(self) -> str:
        """Hash of what plans depend on: the description without its name and `PHYSICAL` fields."""
        data = self.to_dict() | {"name": ""}
        for mount in data["mounts"] or ():
            mount["dynamics"] = None
            mount.pop("visuals", None)
        for name in (*PHYSICAL, "apart", "mounts"):
            if name in PHYSICAL or not data[name]:
                data.pop(name, None)
        return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]

    def to_dict(self) -> dict[str, Any]:
        """Return the description as plain data for JSON.

        What a robot has only if it was read from a file, or is loaded, is left out where it is
        None.
        """
        return asdict(self, dict_factory=_plain)


def _plain(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields of a record as plain data, those that are `SPARSE` where there are any."""
    data = {name: value for name, value in fields if value is not None or name not in SPARSE}
    if "size" in data and data["limb"] is None:  # cargo that no limb holds
        del data["limb"]
    return data


ROBOT_FIELDS = Struct.of(RobotFields)
"""Validators of the fields."""
