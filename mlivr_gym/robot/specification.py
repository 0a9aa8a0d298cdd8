"""The robot: a body with N equal limbs.

Figures of the default robots: the manufacturer's UR5e kinematics and the body
of the published two-limb model, see `envs_assets/ur5e.json`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arguments import Raising, Via
from mlivr_gym.arrays import Array
from mlivr_gym.errors import RobotError, shortened
from mlivr_gym.files import load
from mlivr_gym.robot.capsules import CAPSULE, LINKS, Capsule
from mlivr_gym.robot.limb import FARTHEST_TURN, Limb
from mlivr_gym.robot.limb_dynamics import (
    ARMS,
    LIMB_DYNAMICS,
    MASSES,
    LimbDynamics,
    Named,
    arm_data,
    arm_dynamics,
    arm_limb,
    arm_of,
)
from mlivr_gym.robot.spherical_wrist_limb import LIMB_OF_FAMILY, SphericalWristLimb
from mlivr_gym.schema import NAME, FieldPath, Listed, Maybe, Struct, Tuples, Whole
from mlivr_gym.values import LONGEST_ROBOT, SMALLEST

LIMB_COLOURS = (
    "#d62728",
    "#1f5fd0",
    "#ff9f1c",
    "#17a2a2",
    "#9467bd",
    "#8c564b",
    "#e377c2",
    "#7f7f7f",
)
"""Colour of each limb, in the scene and in figures; red and blue are the paper's."""


SMALLEST_BODY = 1e-3
"""Least edge of the body [m]: of one lighter and smaller MuJoCo refuses the inertia."""

MOST_CAPSULES = 64
"""Most collision shapes of a limb: the compiled checks keep them on the stack."""

MOST_LIMBS = 8
"""Most limbs of a robot."""

MOST_FOLDS = 4
"""Most rows of `RobotSpec.folds`."""

FOLDS_OF_LIMB: tuple[tuple[float, ...], ...] = ((),)
"""Stands for the folds of the limb's family, `Limb.default_folds`."""

MOST_POSES = 64
"""Most heights or rolls that are tried for a stance; the robots that ship have four and five."""


def geometric_order(rolls: Iterable[float]) -> tuple[float, ...]:
    """Rolls [rad] by their size, the positive of two opposite ones first.

    This order is the last rule by which a posture is chosen. The roll is counted about the line to
    the grasp of one limb, with two limbs of limb 0, so which side of a wall is preferred changes
    with the limb that holds either point: no side of the module is favoured.
    """

    def key(roll: float) -> tuple[float, bool]:
        turn = float(np.angle(np.exp(1j * roll)))
        return round(abs(turn), 9), turn < 0.0

    return tuple(sorted(rolls, key=key))


@dataclass(frozen=True)
class RobotSpec:
    """A body with `limbs` equal limbs, mounted at equal angles about the body's z axis.

    The first joint axis of each limb is radial; limb 0 points along the body's +x axis.

    Attributes
    ----------
    name
        Short name.
    limbs
        Number of limbs N, at least 2.
    limb
        Kinematics of one limb.
    mount_radius
        Distance of a limb's base from the body's z axis [m].
    tool_length
        Distance from the flange to the grasp along the flange normal [m].
    characteristic_length
        l_c, which makes lengths and angles comparable in the Jacobian [m].
    grasp_separation
        Least distance of two points held at once [m] (gripper width).
    span
        Greatest distance of two points held at once that is tried [m].
    heights
        Heights of the base over the grasps' centroid that are tried [m], in any order:
        they are kept lowest first.
    rolls
        Rolls about the line from the grasps' centroid to that of limb 0, of more than two
        limbs to the nearest, that are tried [rad], in any order; kept in `geometric_order`.
    lift
        How far a gripper departs along the surface normal before it swings [m].
    folds
        Angles of joints 1 to 5 [rad] at which a free limb may stay folded while the base
        moves, at most four, the preferred first; those that do not lie in the windows of the
        joints are left out. By default those of the limb's family.
    capsules
        Collision shapes of a limb; by default those of the UR5e, stretched to the limb's
        lengths, or those of another family along its links, and a gripper from the flange to the
        grasp.
    body_size
        Edge of the body, a cube [m].
    body_mass
        Mass of the body [kg].
    gripper_mass
        Mass of a gripper [kg].
    dynamics
        Masses, inertias and joint limits of a limb, also by the name of an arm (one of
        `ARMS`); None for those of the arm that has the limb's lengths.
    """

    name: str = "robot"
    limbs: int = 2
    limb: Limb | SphericalWristLimb = field(default_factory=Limb)
    mount_radius: float = 0.1
    tool_length: float = 0.05
    characteristic_length: float = 0.87
    grasp_separation: float = 0.1
    span: float = 2.4
    heights: tuple[float, ...] = (0.60, 0.65, 0.70, 0.75)
    rolls: tuple[float, ...] = tuple(np.deg2rad([0.0, -15.0, 15.0, -30.0, 30.0]).tolist())
    lift: float = 0.1
    folds: tuple[tuple[float, ...], ...] = FOLDS_OF_LIMB
    capsules: tuple[Capsule, ...] | None = None
    body_size: float = 0.2
    body_mass: float = 20.0
    gripper_mass: float = 0.5
    dynamics: LimbDynamics | None = None

    def __post_init__(self) -> None:
        """Check every figure."""
        if self.folds is FOLDS_OF_LIMB:
            object.__setattr__(self, "folds", self.limb.default_folds)
        ROBOT.check(self, FieldPath("", RobotError))
        object.__setattr__(self, "heights", tuple(sorted(self.heights)))
        object.__setattr__(self, "rolls", geometric_order(self.rolls))
        if self.capsules is not None and all(shape.link == "base" for shape in self.capsules):
            raise RobotError(
                "capsules has none on a link that moves; leave it out for those of the UR5e"
            )
        if self.span <= self.grasp_separation:
            raise RobotError(
                f"span is {self.span!r}; it must exceed grasp_separation {self.grasp_separation!r}"
            )

    @property
    def mount_rotations(self) -> Array:
        """Limb base axes in the body frame, shape (N, 3, 3); z is radial, x the body's z axis."""
        azimuth = 2.0 * np.pi * np.arange(self.limbs) / self.limbs
        c, s = np.cos(azimuth), np.sin(azimuth)
        zero, one = np.zeros(self.limbs), np.ones(self.limbs)
        return np.stack(
            [
                np.stack([zero, s, c], -1),
                np.stack([zero, -c, s], -1),
                np.stack([one, zero, zero], -1),
            ],
            axis=1,
        )

    @property
    def mount_positions(self) -> Array:
        """Limb base origins in the body frame [m], shape (N, 3)."""
        return self.mount_radius * self.mount_rotations[:, :, 2]

    @property
    def extent(self) -> float:
        """An upper bound of the distance of any part of the robot from the body's middle [m]."""
        # In the order of `LINKS`, of which the gripper is on the flange.
        origins = (*self.limb.link_distances, self.limb.link_distances[-1])
        farthest = self.limb.reach + self.tool_length
        for capsule in self.shapes:
            end = max(float(np.linalg.norm(end)) for end in (capsule.start, capsule.end))
            farthest = max(farthest, origins[LINKS.index(capsule.link)] + end + capsule.radius)
        return max(self.mount_radius + farthest, float(np.sqrt(0.75) * self.body_size))

    @cached_property
    def shapes(self) -> tuple[Capsule, ...]:
        """Collision shapes of a limb in its link frames.

        The base is fixed to the body; the gripper's frame is the flange's.
        """
        if self.capsules is not None:
            return self.capsules
        data, limb = arm_data("ur5e"), self.limb
        radius = data["gripper"]["radius"]
        tip = self.tool_length - radius
        gripper = Capsule("gripper", (0.0, 0.0, min(0.0, tip)), (0.0, 0.0, tip), radius)
        if not isinstance(limb, Limb):
            return (*limb.link_capsules, gripper)
        published = data["dh"]
        stretch = {
            "upper_arm": (limb.a2 / published["a2"], 1.0, limb.d4 / published["d4"]),
            "forearm": (limb.a3 / published["a3"], 1.0, limb.d4 / published["d4"]),
            "wrist_1": (1.0, 1.0, limb.d5 / published["d5"]),
            "wrist_3": (1.0, 1.0, limb.d6 / published["d6"]),
        }  # fmt: skip
        out = []
        for entry in data["capsules"]:
            factor = np.array(stretch.get(entry["link"], (1.0, 1.0, 1.0)))
            start, end = (tuple((np.array(entry[name]) * factor).tolist()) for name in ("p0", "p1"))
            out.append(Capsule(entry["link"], start, end, entry["r"]))
        return (*out, gripper)

    @property
    def limb_dynamics(self) -> LimbDynamics:
        """Masses, inertias and joint limits of a limb.

        Raises
        ------
        RobotError
            If they are not given, and the limb's lengths are those of no arm that
            ships: another arm's figures would be wrong without a word.
        """
        if self.dynamics is not None:
            return self.dynamics
        name = arm_of(self.limb)
        if name is None:
            lengths = ", ".join(f"{length:g}" for length in self.limb.lengths)
            raise RobotError(
                f"robot {self.name!r} cannot be simulated: its limbs' lengths {lengths} m are "
                f"those of none of {', '.join(ARMS)}, whose masses, inertias and torque limits "
                "are known; give its `dynamics`, or the name of one of these arms as `dynamics` "
                "to take that arm's figures"
            )
        return arm_dynamics(name)

    @property
    def fingerprint(self) -> str:
        """Hash of what plans depend on: the description but for its name and `dynamics`."""
        data = {name: value for name, value in self.to_dict().items() if name != "dynamics"}
        return hashlib.sha256(json.dumps(data | {"name": ""}, sort_keys=True).encode()).hexdigest()[
            :16
        ]

    def to_dict(self) -> dict[str, Any]:
        """The description as plain data for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Any, name: str = "robot") -> RobotSpec:
        """Build a robot from plain data, the inverse of `to_dict`.

        Missing fields keep their defaults.

        Parameters
        ----------
        data
            The plain data.
        name
            Used when the data names none.

        Raises
        ------
        RobotError
            naming an unknown field or a faulty value.
        """
        given = {"name": name} | data if isinstance(data, dict) else data
        return ROBOT.read(given, FieldPath("", RobotError))

    @classmethod
    def load(cls, path: str | Path) -> RobotSpec:
        """Read a robot from a JSON file; one without a name is called like the file.

        Raises
        ------
        RobotError
            If the file cannot be read or a field is faulty.
        """
        name = Path(path).stem
        return load(path, "robot", RobotError, lambda data: cls.from_dict(data, name))


SIZE = Tuples((), 0.0, LONGEST_ROBOT, "m")
"""A length that may be zero."""

ROBOT = Struct(
    RobotSpec,
    {
        "name": NAME,
        "limbs": Whole(2, MOST_LIMBS),
        "limb": Named(LIMB_OF_FAMILY, arm_limb),
        "mount_radius": SIZE,
        "tool_length": SIZE,
        "characteristic_length": Tuples((), SMALLEST, LONGEST_ROBOT, "m"),
        "grasp_separation": SIZE,
        "span": Tuples((), SMALLEST, LONGEST_ROBOT, "m"),
        "heights": Tuples((None,), -LONGEST_ROBOT, LONGEST_ROBOT, "m", (1, MOST_POSES)),
        "rolls": Tuples((None,), -FARTHEST_TURN, FARTHEST_TURN, "rad", (1, MOST_POSES)),
        "lift": SIZE,
        "folds": Tuples((None, 5), -FARTHEST_TURN, FARTHEST_TURN, "rad", (1, MOST_FOLDS)),
        "capsules": Maybe(Listed(CAPSULE, most=MOST_CAPSULES)),
        "body_size": Tuples((), SMALLEST_BODY, LONGEST_ROBOT, "m"),
        "body_mass": Tuples((), *MASSES, "kg"),
        "gripper_mass": Tuples((), *MASSES, "kg"),
        "dynamics": Maybe(Named(LIMB_DYNAMICS, arm_dynamics)),
    },
)
"""Fields of a `RobotSpec`."""

MLIVR2 = RobotSpec(name="mlivr2")
"""Two UR5e on opposite faces of a 0.2 m cube of 20 kg."""

ROBOTS = {f"mlivr{n}": replace(MLIVR2, name=f"mlivr{n}", limbs=n) for n in (2, 3, 4)}
"""The robots that ship with the package."""

_PLACE = FieldPath("robot", RobotError)


def robot_spec(robot: str | RobotSpec | dict[str, Any], place: FieldPath = _PLACE) -> RobotSpec:
    """A robot by name, by path of a JSON file, from plain data (`RobotSpec.to_dict`), or as it is.

    Raises
    ------
    RobotError
        If the name is unknown and no such file exists, or the plain data are faulty.
    """
    if isinstance(robot, RobotSpec):
        return robot
    if isinstance(robot, dict):
        return place.build(RobotSpec.from_dict, robot)
    if isinstance(robot, str) and robot in ROBOTS:
        return ROBOTS[robot]
    if isinstance(robot, str) and os.path.isfile(robot):
        return RobotSpec.load(robot)
    raise RobotError(
        f"unknown robot {shortened(robot)}; valid names are {', '.join(ROBOTS)}, "
        "or give the path of a JSON file"
    )


ROBOT_OR_NAME = Raising(RobotError, Via(robot_spec))
"""A robot as `robot_spec` takes it."""
