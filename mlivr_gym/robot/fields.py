"""The fields of a robot, and what follows from them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import LINKS, GivenCapsules, default_capsules
from mlivr_gym.robot.cargo import CARGO, Cargo, check_room
from mlivr_gym.robot.limb import Limb
from mlivr_gym.robot.limb_dynamics import (
    ARMS,
    GIVEN_LIMB,
    GivenDynamics,
    LimbDynamics,
    arm_dynamics,
    arm_of,
)
from mlivr_gym.robot.mounts import MOUNT, Mount, are_even, even_mounts
from mlivr_gym.robot.rigid import RigidBody, box_inertia, combined
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
    edges_of,
)
from mlivr_gym.robot.visuals import GivenVisuals
from mlivr_gym.schema import NAME, FieldPath, Integer, ListOf, OrNone, Struct, Text, Tuples
from mlivr_gym.values import MAX_REMARK_LENGTH, MAX_ROBOT_LENGTH, MIN_SIZE, Triple

FOLDS_OF_LIMB: tuple[tuple[float, ...], ...] = ((),)
"""Stands for `Limb.default_folds`."""

PHYSICAL = ("dynamics", "body_centre", "body_inertia", "source", "visuals", "joint_names")
"""Fields of a robot on which no plan depends."""

SPARSE = ("visuals", "cargo", "joint_names")
"""Fields of robots, and of their parts, that plain data name only where there are any."""


def geometric_order(rolls: Iterable[float]) -> tuple[float, ...]:
    """Return rolls [rad] sorted by size, the positive one of two opposite rolls first.

    This order is the last rule by which a posture is chosen. A roll is counted about the line to
    the grasp of one limb, with two limbs of limb 0, so the side of a wall that is preferred changes
    with the limb that holds either point: no side of the module is favoured.
    """

    def key(roll: float) -> tuple[float, bool]:
        turn = float(np.angle(np.exp(1j * roll)))
        return round(abs(turn), 9), turn < 0.0

    return tuple(sorted(rolls, key=key))


@dataclass(frozen=True)
class RobotFields:
    """The fields of a `RobotSpec`, and what follows from them."""

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
    characteristic_length: Annotated[float, POSITIVE] = 0.87
    """l_c, which makes lengths and angles comparable in the Jacobian [m]."""
    grasp_separation: Annotated[float, LENGTH] = 0.1
    """Smallest distance of two points held at once [m] (gripper width)."""
    span: Annotated[float, POSITIVE] = 2.4
    """Largest distance of two points that a stance may hold [m]."""
    heights: Annotated[
        tuple[float, ...],
        Tuples((None,), -MAX_ROBOT_LENGTH, MAX_ROBOT_LENGTH, "m", (1, MOST_POSES)),
    ] = (0.60, 0.65, 0.70, 0.75)
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
        if self.cargo is not None:
            check_room(self.cargo, self.cargo_frame, self.mounted)
        names = [name for limb in self.joint_names or () for name in limb]
        if len(names) not in (0, 6 * self.limbs):
            raise RobotError(
                f"joint_names is of {len(names) // 6} limbs; the robot has {self.limbs}"
            )
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

    @property
    def _places(self) -> tuple[Mount, ...]:
        """Each limb where it is mounted, with what it does not share with the others."""
        return self.mounts or even_mounts(self.limbs, self.mount_radius)

    def _with_shared(self, mount: Mount) -> Mount:
        """Return a mount with what its limb shares with the other limbs."""
        if mount.limb is not None:
            return mount
        return replace(
            mount, limb=self.limb, capsules=mount.capsules or self.capsules,
            dynamics=mount.dynamics or self.dynamics, visuals=mount.visuals or self.visuals,
        )  # fmt: skip

    @cached_property
    def mounted(self) -> tuple[Mount, ...]:
        """Each limb with its place, its kinematics, its capsules and its dynamics, N of them.

        Where the first joint of a limb is locked, its place is that of the first joint that moves,
        unlike that of `whole_mounts`.
        """
        limbs = zip(self.whole_mounts, self.every_limb, strict=True)
        bases = [mount.frame @ limb.base_in_mount for mount, limb in limbs]
        return tuple(
            replace(mount, position=base[:3, 3].tolist(), rotation=base[:3, :3].tolist())
            for mount, base in zip(self.whole_mounts, bases, strict=True)
        )

    @cached_property
    def whole_mounts(self) -> tuple[Mount, ...]:
        """Each limb where it is mounted, with all that it has, to be given to another robot.

        `Mount.dynamics` is None where it is neither given nor that of an arm that ships.
        """
        return tuple(map(self._completed, self._places))

    def _completed(self, mount: Mount) -> Mount:
        whole = self._with_shared(mount)
        assert whole.limb is not None
        name = arm_of(whole.limb)
        return replace(
            whole, capsules=whole.capsules or default_capsules(whole.limb, self.tool_length),
            dynamics=whole.dynamics or (arm_dynamics(name) if name else None),
        )  # fmt: skip

    @cached_property
    def every_limb(self) -> tuple[Limb, ...]:
        """Kinematics of each limb, N of them."""
        return tuple(mount.limb or self.limb for mount in self._places)

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether plans are the same after a turn by one limb about the body's z axis.

        Its limbs are equal and evenly mounted, that of limb 0 along the body's x axis, and the body
        of more than two limbs is a cube. Cargo must lie on the axis of two limbs.
        """
        if self.cargo is not None and (self.limbs > 2 or self.cargo_frame[:2, 3].any()):
            return False
        if self.limbs > 2 and len(set(self.body_edges.tolist())) > 1:
            return False
        return self.mounts is None or are_even(self.mounted)

    def is_apart(self, first: str, second: str) -> bool:
        """Return whether the shapes of two links of a limb never meet, see `RobotSpec.apart`."""
        return any({first, second} == set(pair) for pair in self.apart)

    @property
    def named_joints(self) -> tuple[tuple[str, ...], ...]:
        """Names of the joints that move, N times six: those of the file the robot is read from.

        Joint k of limb i of another robot is `"limb{i}/joint{k}"`.
        """
        return self.joint_names or tuple(
            tuple(f"limb{i}/joint{k}" for k in range(1, 7)) for i in range(self.limbs)
        )

    @property
    def mount_rotations(self) -> Array:
        """Limb base axes in the body frame, shape (N, 3, 3); z is the axis of the first joint."""
        return np.array([mount.rotation for mount in self.mounted])

    @property
    def mount_positions(self) -> Array:
        """Limb base origins in the body frame [m], shape (N, 3)."""
        return np.array([mount.position for mount in self.mounted])

    @property
    def mount_directions(self) -> Array:
        """Where the shoulders lie across the body's z axis, from their middle [m], shape (N, 2).

        What is below a nanometre counts as 0: rounding must not choose a direction.
        """
        lengths = np.array([limb.shoulder_height for limb in self.every_limb])
        shoulders = self.mount_positions + lengths[:, None] * self.mount_rotations[:, :, 2]
        across: Array = (shoulders - shoulders.mean(axis=0))[:, :2]
        return np.where(np.abs(across) < MIN_SIZE, 0.0, across)

    @property
    def joint_limits(self) -> Array:
        """Joint limits of every limb [rad], shape (N, 6, 2)."""
        return np.array([limb.limits for limb in self.every_limb])

    @property
    def body_edges(self) -> Array:
        """Edges of the body along x, y and z [m], shape (3,)."""
        return edges_of(self.body_size)

    @property
    def body_solid(self) -> RigidBody:
        """Mass, centre and inertia of the body with cargo and locked limb, in the body frame."""
        inertia = self.body_inertia or box_inertia(self.body_mass, self.body_edges)
        body = RigidBody(self.body_mass, self.body_centre, inertia)
        if self.cargo is None:
            return body
        bag = self.cargo.solid.moved(self.cargo_frame)
        return combined([body, bag, *self.cargo.limb_solids(self.gripper_mass, self.tool_length)])

    @property
    def cargo_frame(self) -> Array:
        """Frame of the middle of the cargo in the body frame, shape (4, 4); of the body if none."""
        if self.cargo is None:
            return np.eye(4)
        return self.cargo.frame_on(self.body_edges, self.tool_length)

    @cached_property
    def reach(self) -> float:
        """An upper bound of the distance of a grasp from the body's origin [m]."""
        reaches = [float(np.linalg.norm(one.position)) for one in self._places]
        limbs = zip(reaches, self.every_limb, strict=True)
        return max(away + limb.reach for away, limb in limbs) + self.tool_length

    @cached_property
    def extent(self) -> float:
        """An upper bound of the distance of any part of the robot from the body's middle [m]."""
        parts = [self.reach, 0.5 * float(np.linalg.norm(self.body_edges))]
        if self.cargo is not None:
            # The capsules that cover the cargo protrude by less than a quarter of its edges.
            frame = self.cargo_frame
            corner = np.abs(frame[:3, :3].T @ frame[:3, 3]) + 0.75 * self.cargo.edges
            parts.append(float(np.linalg.norm(corner)))
            for _, ends, radius in self.cargo.limb_capsules:
                parts.append(float(np.linalg.norm(ends, axis=1).max()) + radius)
        for place, mount, limb in zip(self._places, self.mounted, self.every_limb, strict=True):
            # In the order of `LINKS`, of which the gripper is on the flange.
            origins = (*limb.link_distances, limb.reach)
            for shape in mount.capsules or ():
                end = max(float(np.linalg.norm(end)) for end in (shape.start, shape.end))
                away = float(np.linalg.norm(place.position)) + origins[LINKS.index(shape.link)]
                parts.append(away + end + shape.radius)
        return max(parts)

    def dynamics_of(self, limb: int) -> LimbDynamics:
        """Return the masses, inertias and joint limits of a limb, by its number from 0.

        Raises a `RobotError` if they are not given and the limb's lengths are those of no arm that
        ships: another arm's figures would be wrong without notice.
        """
        dynamics = self.mounted[limb].dynamics
        if dynamics is None:
            raise RobotError(
                f"robot {self.name!r} cannot be simulated: its limbs' links are "
                f"those of none of {', '.join(ARMS)}, whose masses, inertias and torque limits "
                "are known; give its `dynamics`, or the name of one of these arms as `dynamics` "
                f"to take that arm's figures (source of the robot: {self.source or 'not told'})"
            )
        return dynamics

    @property
    def torque_limits(self) -> Array:
        """Largest torque of every joint [N m], shape (N, 6), see `dynamics_of`."""
        return np.array([self.dynamics_of(i).torque_limits for i in range(self.limbs)])

    @property
    def speed_limits(self) -> Array:
        """Largest speed of every joint [rad/s], shape (N, 6), see `dynamics_of`."""
        return np.array([self.dynamics_of(i).speed_limits for i in range(self.limbs)])

    @property
    def dynamics_source(self) -> str:
        """Whose masses, inertias, torque and speed limits a simulation takes, for each limb."""
        known = {arm_dynamics(name): f"those of the {name}" for name in ARMS} | {None: "not known"}
        told = [known.get(mount.dynamics, "given with the robot") for mount in self.mounted]
        return told[0] if len(set(told)) == 1 else "; ".join(told)


def _plain(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields of a record as plain data, those that are `SPARSE` where there are any."""
    data = {name: value for name, value in fields if value is not None or name not in SPARSE}
    if "size" in data and data["limb"] is None:  # cargo that no limb holds
        del data["limb"]
    return data


ROBOT_FIELDS = Struct.of(RobotFields)
"""Validators of the fields."""
