"""The robot: a body with N equal limbs of the UR family.

Figures of the default robots: the manufacturer's UR5e kinematics and the body
of the published two-limb model, see `envs_assets/ur5e.json`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.envs_assets import asset_path
from mlivr_gym.errors import MlivrError, RobotError, shown
from mlivr_gym.files import read_json
from mlivr_gym.robot.capsules import LINKS, Capsule
from mlivr_gym.values import LONGEST_ROBOT, SMALLEST, entries, number, numbers, text, whole

LIMB_COLOURS = (
    "#1f77b4",
    "#ff7f0e",
    "#2ca02c",
    "#d62728",
    "#9467bd",
    "#8c564b",
    "#e377c2",
    "#7f7f7f",
)
"""Colour of each limb, in the scene and in figures."""


@cache
def ur5e_data() -> dict[str, Any]:
    """Figures of the UR5e with their sources, as shipped."""
    return read_json(asset_path("ur5e.json"), "robot", RobotError)


FARTHEST_TURN = 100.0
"""Largest joint limit or angle [rad], 16 turns; a UR joint has one in each direction."""

MASSES = (1e-3, 1e6)
"""Least and largest mass of a part [kg]: a gram, and twice the ISS."""

SMALLEST_BODY = 1e-3
"""Least edge of the body [m]: of one lighter and smaller MuJoCo refuses the inertia."""

MOST_CAPSULES = 64
"""Most collision shapes of a limb: the compiled checks keep them on the stack."""

MOST_LIMBS = 8
"""Most limbs of a robot."""

MOST_POSES = 64
"""Most heights or rolls that are tried for a stance; the robots that ship have four and five."""


WINDOW_STARTS = (
    -1.65, 1.75 - 2.0 * np.pi, -np.pi, 1.75 - 2.0 * np.pi, -np.pi, -0.75 * np.pi,
)  # fmt: skip
"""Where the windows of a UR limb begin [rad], see `Limb.windows`.

Joints 3 and 5 never pass half a turn while a limb holds, since the arm is singular there. Joints 1,
2 and 4 of limbs that hold points of the JEM pass 1.65 rad on 0.05 % of the steps only. Joint 6 may
be half a turn further, the flip: one of the two passes the ends of its window only where the tool
turns by half a turn and more.
"""


@dataclass(frozen=True)
class Limb:
    """A six-joint arm of the UR family, standard DH convention `Rz(theta) Tz(d) Tx(a) Rx(alpha)`.

    The default lengths [m] are the UR5e's, published by the manufacturer.
    """

    d1: float = 0.1625
    a2: float = -0.425
    a3: float = -0.3922
    d4: float = 0.1333
    d5: float = 0.0997
    d6: float = 0.0996
    joint_limits: tuple[tuple[float, float], ...] = ((-2 * np.pi, 2 * np.pi),) * 6
    """Lower and upper limit of each joint [rad]."""
    window_starts: tuple[float, ...] = WINDOW_STARTS
    """Where the turn begins in which each joint stays while the limb holds [rad], see `windows`."""

    def __post_init__(self) -> None:
        """Check lengths and limits."""
        for name in ("d1", "a2", "a3", "d4", "d5", "d6"):
            value = number(getattr(self, name), f"limb length {name}", RobotError, LONGEST_ROBOT)
            if name in ("a2", "a3", "d4") and abs(value) < SMALLEST:
                raise RobotError(f"limb length {name} is {value:g}; it must not be 0")
            object.__setattr__(self, name, value)
        limits = numbers(self.joint_limits, (6, 2), "joint_limits", RobotError)
        if not (limits[:, 0] < limits[:, 1]).all() or np.abs(limits).max() > FARTHEST_TURN:
            raise RobotError(
                f"joint_limits {limits.tolist()} must be lower below upper, "
                f"from {-FARTHEST_TURN:g} to {FARTHEST_TURN:g} rad"
            )
        object.__setattr__(self, "joint_limits", tuple((float(a), float(b)) for a, b in limits))
        starts = numbers(self.window_starts, (6,), "window_starts", RobotError, FARTHEST_TURN)
        object.__setattr__(self, "window_starts", tuple(starts.tolist()))

    @property
    def lengths(self) -> Array:
        """The six lengths d1, a2, a3, d4, d5, d6 [m], shape (6,)."""
        return np.array([self.d1, self.a2, self.a3, self.d4, self.d5, self.d6], dtype=np.float64)

    @property
    def limits(self) -> Array:
        """Joint limits [rad], shape (6, 2)."""
        return np.array(self.joint_limits)

    @property
    def windows(self) -> Array:
        """Least and largest angle of each joint of a limb that holds [rad], shape (6, 2).

        A window is one turn from `window_starts` on, moved into the joint limits as far as needed,
        and no more than they allow. Within it a posture has one winding: a limb never needs to turn
        back, so every walk of steps that are legal one by one can be carried out. A step on which a
        joint of a limb that holds would leave its window is no edge for the branch concerned.
        """
        low, high = self.limits.T
        start = np.clip(self.window_starts, low, np.maximum(low, high - 2.0 * np.pi))
        return np.stack([start, np.minimum(start + 2.0 * np.pi, high)], axis=1)

    def folds_in_windows(self, folds: Sequence[Sequence[float]]) -> Array:
        """Those of some folds, joints 1 to 5 [rad], that lie in the windows, shape (k, 5)."""
        low, high = self.windows[:5].T
        angles = np.array(folds, dtype=np.float64).reshape(-1, 5)
        angles = low + np.mod(angles - low, 2.0 * np.pi)
        inside: Array = angles[(angles <= high).all(axis=1)]
        return inside

    @property
    def reach(self) -> float:
        """An upper bound of the flange's distance from the mount [m]."""
        return float(np.abs(self.lengths).sum())


FOLDS = (
    (-0.6, np.pi, 2.4, 0.0, -0.75),
    (0.3, np.pi, 0.0, -1.6, 0.75),
    (2.19, -0.15, 1.83, 0.7, -0.38),
)
"""Joints 1 to 5 [rad] of a UR limb folded beside the body, on the side away from the surface.

Chosen from postures that keep clear of the body: each in turn adds most steps of the JEM over which
a limb can fold, stay folded and unfold.
"""


def geometric_order(rolls: Iterable[float]) -> tuple[float, ...]:
    """Rolls [rad] by their size, the positive of two opposite ones first.

    This order is the last rule by which a posture is chosen. The roll is counted about the line to
    the grasp of limb 0, so which side of a wall is preferred changes with the limb that holds
    either point: no side of the module is favoured.
    """

    def key(roll: float) -> tuple[float, bool]:
        turn = float(np.angle(np.exp(1j * roll)))
        return round(abs(turn), 9), turn < 0.0

    return tuple(sorted(rolls, key=key))


@dataclass(frozen=True)
class RobotSpec:
    """A body with `limbs` equal limbs, mounted at equal angles about the body's z axis.

    The first joint axis of each limb is radial; limb 0 points along the body's +x axis.

    Attributes:
        name: Short name.
        limbs: Number of limbs N, at least 2.
        limb: Kinematics of one limb.
        mount_radius: Distance of a limb's base from the body's z axis [m].
        tool_length: Distance from the flange to the grasp along the flange normal [m].
        characteristic_length: l_c, which makes lengths and angles comparable in the Jacobian [m].
        grasp_separation: Least distance of two points held at once [m] (gripper width).
        span: Greatest distance of two points held at once that is tried [m].
        heights: Heights of the base over the grasps' centroid that are tried [m], in any order:
            they are kept lowest first.
        rolls: Rolls about the line from the grasps' centroid to that of limb 0 that are tried
            [rad], in any order; kept in `geometric_order`.
        lift: How far a gripper departs along the surface normal before it swings [m].
        folds: Angles of joints 1 to 5 [rad] at which a free limb may stay folded while the base
            moves, at most four, the preferred first.
        capsules: Collision shapes of a limb; by default those of the UR5e, stretched to the limb's
            lengths, and a gripper from the flange to the grasp.
        body_size: Edge of the body, a cube [m].
        body_mass: Mass of the body [kg].
        gripper_mass: Mass of a gripper [kg].
    """

    name: str = "mlivr2"
    limbs: int = 2
    limb: Limb = field(default_factory=Limb)
    mount_radius: float = 0.1
    tool_length: float = 0.05
    characteristic_length: float = 0.87
    grasp_separation: float = 0.1
    span: float = 2.4
    heights: tuple[float, ...] = (0.60, 0.65, 0.70, 0.75)
    rolls: tuple[float, ...] = tuple(np.deg2rad([0.0, -15.0, 15.0, -30.0, 30.0]).tolist())
    lift: float = 0.1
    folds: tuple[tuple[float, ...], ...] = FOLDS
    capsules: tuple[Capsule, ...] | None = None
    body_size: float = 0.2
    body_mass: float = 20.0
    gripper_mass: float = 0.5

    def __post_init__(self) -> None:
        """Check every figure."""
        text(self.name, "the name of the robot", RobotError)
        object.__setattr__(self, "limbs", whole(self.limbs, "limbs", RobotError, 2, MOST_LIMBS))
        if not isinstance(self.limb, Limb):
            raise RobotError(f"limb is {shown(self.limb)}; it must be a Limb")
        for name, most in (("heights", LONGEST_ROBOT), ("rolls", np.inf)):
            given = entries(getattr(self, name), name, RobotError, MOST_POSES)
            if not given:
                raise RobotError(f"{name} must be one or more numbers")
            values = numbers(given, (len(given),), name, RobotError, most).tolist()
            object.__setattr__(
                self, name, geometric_order(values) if name == "rolls" else tuple(sorted(values))
            )
        self._check_folds_and_shapes()
        for name in ("mount_radius", "tool_length", "grasp_separation", "lift"):
            self._check(name, 0.0, LONGEST_ROBOT)
        for name in ("characteristic_length", "span"):
            self._check(name, SMALLEST, LONGEST_ROBOT)
        self._check("body_size", SMALLEST_BODY, LONGEST_ROBOT)
        for name in ("body_mass", "gripper_mass"):
            self._check(name, *MASSES)
        if self.span <= self.grasp_separation:
            raise RobotError(
                f"span is {self.span!r}; it must exceed grasp_separation {self.grasp_separation!r}"
            )

    def _check_folds_and_shapes(self) -> None:
        folds = entries(self.folds, "folds", RobotError)
        if not 1 <= len(folds) <= 4:
            raise RobotError(
                f"folds has {len(folds)} rows; it must have one to four, of five joint angles each"
            )
        rows = numbers(folds, (len(folds), 5), "folds", RobotError).tolist()
        object.__setattr__(self, "folds", tuple(tuple(row) for row in rows))
        if self.capsules is not None:
            capsules = tuple(entries(self.capsules, "capsules", RobotError, MOST_CAPSULES))
            if any(not isinstance(capsule, Capsule) for capsule in capsules):
                raise RobotError(f"capsules are {shown(capsules)}; each must be a Capsule")
            if all(capsule.link == "base" for capsule in capsules):
                raise RobotError(
                    "capsules has none on a link that moves; leave it out for those of the UR5e"
                )
            object.__setattr__(self, "capsules", capsules)

    def _check(self, name: str, least: float, most: float) -> None:
        value = number(getattr(self, name), name, RobotError)
        if not least <= value <= most:
            unit = "kg" if name.endswith("mass") else "m: lengths are in metres"
            raise RobotError(
                f"{name} of robot {self.name!r} is {value:g}; "
                f"it must lie between {least:g} and {most:g} {unit}"
            )
        object.__setattr__(self, name, value)

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
        d1, a2, a3, d4, d5, d6 = np.abs(self.limb.lengths).tolist()
        # Distance of each link's origin from the limb's base at most, in the order of `LINKS`.
        origins = np.cumsum([0.0, d1, 0.0, a2, a3 + d4, d5, d6, 0.0]).tolist()
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
        data, limb = ur5e_data(), self.limb
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
        radius = data["gripper"]["radius"]
        tip = self.tool_length - radius
        out.append(Capsule("gripper", (0.0, 0.0, min(0.0, tip)), (0.0, 0.0, tip), radius))
        return tuple(out)

    @property
    def fingerprint(self) -> str:
        """Hash of the description, but for its name."""
        return hashlib.sha256(
            json.dumps(self.to_dict() | {"name": ""}, sort_keys=True).encode()
        ).hexdigest()[:16]

    def to_dict(self) -> dict[str, Any]:
        """The description as plain data for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Any) -> RobotSpec:
        """Build a robot from plain data, the inverse of `to_dict`.

        Missing fields keep their defaults.

        Raises:
            RobotError: naming an unknown field or a faulty value.
        """
        if not isinstance(data, dict):
            raise RobotError(f"a robot is a JSON object, not {shown(data)}")
        values = {
            **_fields(cls, data, "robot"),
            "limb": Limb(**_fields(Limb, data.get("limb", {}), "limb")),
        }
        if data.get("capsules") is not None:
            capsules = entries(data["capsules"], "capsules", RobotError, MOST_CAPSULES)
            values["capsules"] = tuple(
                Capsule(**_fields(Capsule, entry, "capsule")) for entry in capsules
            )
        return cls(**values)

    @classmethod
    def load(cls, path: str | Path) -> RobotSpec:
        """Read a robot from a JSON file.

        Raises:
            RobotError: If the file cannot be read or a field is faulty.
        """
        data = read_json(path, "robot", RobotError)
        try:
            return cls.from_dict(data)
        except MlivrError as error:
            raise type(error)(f"robot {str(path)!r}: {error}") from None


def _fields(kind: type[Any], data: Any, what: str) -> dict[str, Any]:
    """The data of a record, if it has known fields only, and all that have no default."""
    if not isinstance(data, dict):
        raise RobotError(f"{what} must be an object, not {shown(data)}")
    known = [entry.name for entry in fields(kind)]
    for name in data:
        if name not in known:
            raise RobotError(
                f"unknown {what} field {shown(name)}; valid fields are {', '.join(known)}"
            )
    for entry in fields(kind):
        if entry.name not in data and entry.default is MISSING and entry.default_factory is MISSING:
            raise RobotError(f"{what} lacks field {entry.name!r}")
    return data


MLIVR2 = RobotSpec()
"""Two UR5e on opposite faces of a 0.2 m cube of 20 kg."""

ROBOTS = {f"mlivr{n}": replace(MLIVR2, name=f"mlivr{n}", limbs=n) for n in (2, 3, 4)}
"""The robots that ship with the package."""


def robot_spec(robot: str | RobotSpec | dict[str, Any]) -> RobotSpec:
    """A robot by name, by path of a JSON file, from plain data (`RobotSpec.to_dict`), or as it is.

    Raises:
        RobotError: If the name is unknown and no such file exists, or the plain data are faulty.
    """
    if isinstance(robot, RobotSpec):
        return robot
    if isinstance(robot, dict):
        return RobotSpec.from_dict(robot)
    if isinstance(robot, str) and robot in ROBOTS:
        return ROBOTS[robot]
    if isinstance(robot, str) and os.path.isfile(robot):
        return RobotSpec.load(robot)
    raise RobotError(
        f"unknown robot {shown(robot)}; valid names are {', '.join(ROBOTS)}, "
        "or give the path of a JSON file"
    )
