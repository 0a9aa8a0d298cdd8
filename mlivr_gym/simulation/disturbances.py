"""A simulated robot and module that are not those the controller knows.

`Disturbances` says how far each figure may be off; `draw` gives one `Disturbance`, a robot and
module with figures of their own. `ALL` has the sizes that are studied. They are assumptions of the
order that arms and stations show: friction of the UR5e's joints is identified by Clochiatti,
Scalera, Boscariol and Gasparetto, "Electro-mechanical modeling and identification of the UR5
e-series robot", Robotica 42, 2024; accelerations in the ISS are described by McPherson, Hrovat,
Kelly and Keller, "Researcher's Guide to: International Space Station Acceleration Environment",
NASA, 2015. For encoders, points and grasps of this robot no figures are published.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.schema import Kind, Tuples
from mlivr_gym.simulation.figures import Figures
from mlivr_gym.simulation.gl import mujoco

STANDARD_GRAVITY = 9.80665
"""One g [m/s^2]."""


@dataclass(frozen=True)
class Disturbances(Figures):
    """How far figures may be off; 0 everywhere is the robot that the controller knows.

    Attributes
    ----------
    friction
        Coulomb friction of each joint, drawn evenly from 0 to this [N m].
    damping
        Viscous friction of each joint, drawn evenly from 0 to this [N m s/rad].
    encoder_bias
        Error of each encoder, evenly within plus and minus this [rad].
    encoder_noise
        Standard deviation of each reading [rad].
    speed_noise
        Standard deviation of each reading of a joint's speed [rad/s].
    delay
        Time from a reading to the torque that it leads to [s].
    acceleration
        Residual acceleration, of this size in a direction drawn for a walk [g].
    payload
        Mass fixed to the middle of the body, evenly from 0 to this [kg].
    masses
        Mass and inertia of each body, by a factor evenly within 1 plus and minus this.
    stiffness
        Stiffness and damping of each grasp, by a factor from one over this to this,
        evenly by its logarithm; 1 for none.
    point_position
        Displacement of each point, evenly within a ball of this radius [m].
    point_angle
        Turn of each point about an axis drawn for it, evenly from 0 to this [rad].
    sensor_position
        Standard deviation of the sensor's reading of a position [m].
    sensor_angle
        Standard deviation of its reading of an angle [rad].
    """

    friction: float = 0.0
    damping: float = 0.0
    encoder_bias: float = 0.0
    encoder_noise: float = 0.0
    speed_noise: float = 0.0
    delay: float = 0.0
    acceleration: float = 0.0
    payload: float = 0.0
    masses: float = 0.0
    stiffness: float = 1.0
    point_position: float = 0.0
    point_angle: float = 0.0
    sensor_position: float = 0.001
    sensor_angle: float = float(np.deg2rad(0.5))

    called: ClassVar[str] = "disturbances"
    kinds: ClassVar[Mapping[str, Kind[Any]]] = {
        "friction": Tuples((), 0.0, 1e3, "N m"),
        "damping": Tuples((), 0.0, 1e3, "N m s/rad"),
        "encoder_bias": Tuples((), 0.0, 1.0, "rad"),
        "encoder_noise": Tuples((), 0.0, 1.0, "rad"),
        "speed_noise": Tuples((), 0.0, 10.0, "rad/s"),
        "delay": Tuples((), 0.0, 0.1, "s"),
        "acceleration": Tuples((), 0.0, 1.0, "g"),
        "payload": Tuples((), 0.0, 1e4, "kg"),
        "masses": Tuples((), 0.0, 0.9),
        "stiffness": Tuples((), 1.0, 100.0),
        "point_position": Tuples((), 0.0, 1.0, "m"),
        "point_angle": Tuples((), 0.0, 1.0, "rad"),
        "sensor_position": Tuples((), 0.0, 1.0, "m"),
        "sensor_angle": Tuples((), 0.0, 1.0, "rad"),
    }

    def only(self, name: str) -> Disturbances:
        """One of them, the others as they are by default."""
        return replace(Disturbances(), **{name: getattr(self, name)})

    def draw(self, seed: int, body_count: int, limbs: int, points: int) -> Disturbance:
        """One robot and module.

        Each figure has a stream of its own, so that it is the same whatever the others are.

        Parameters
        ----------
        seed
            Seed; the same one draws the same.
        body_count
            Parts of the robot that have a mass, MuJoCo's bodies.
        limbs
            Its limbs, N.
        points
            Points of the map, m.
        """
        streams = dict(
            zip(
                [field.name for field in fields(self)],
                map(np.random.default_rng, np.random.SeedSequence(seed).spawn(len(fields(self)))),
                strict=True,
            )
        )
        joints = (limbs, 6)
        ball = streams["point_position"]
        offsets = _directions(ball, points) * ball.uniform(size=(points, 1)) ** (1.0 / 3.0)
        turns = _directions(streams["point_angle"], points)
        turns *= streams["point_angle"].uniform(size=(points, 1))
        grasps = streams["stiffness"].uniform(-1.0, 1.0, limbs)
        return Disturbance(
            seed=seed,
            sizes=self,
            friction=self.friction * streams["friction"].uniform(size=joints),
            damping=self.damping * streams["damping"].uniform(size=joints),
            encoder_bias=self.encoder_bias * streams["encoder_bias"].uniform(-1.0, 1.0, joints),
            gravity=self.acceleration
            * STANDARD_GRAVITY
            * _directions(streams["acceleration"], 1)[0],
            payload=self.payload * float(streams["payload"].uniform()),
            masses=1.0 + self.masses * streams["masses"].uniform(-1.0, 1.0, body_count),
            stiffness=self.stiffness**grasps,
            point_offsets=self.point_position * offsets,
            point_turns=self.point_angle * turns,
        )


@dataclass(frozen=True)
class Disturbance:
    """A robot and module with figures of their own.

    Attributes
    ----------
    seed
        Seed of its draw, and of the noise of readings.
    sizes
        What it was drawn from.
    friction
        Of each joint, shape (N, 6) [N m].
    damping
        Of each joint, shape (N, 6) [N m s/rad].
    encoder_bias
        Reading less angle, shape (N, 6) [rad].
    gravity
        Residual acceleration, shape (3,) [m/s^2].
    payload
        Mass in the middle of the body [kg].
    masses
        Factor of each body's mass and inertia, in the order of the robot's bodies.
    stiffness
        Factor of each grasp's stiffness and damping, shape (N,).
    point_offsets
        Where points are, less where the map has them, shape (m, 3) [m].
    point_turns
        How points are turned against the map, rotation vectors (m, 3) [rad].
    """

    seed: int
    sizes: Disturbances
    friction: Array
    damping: Array
    encoder_bias: Array
    gravity: Array
    payload: float
    masses: Array
    stiffness: Array
    point_offsets: Array
    point_turns: Array

    def apply(self, model: mujoco.MjModel) -> None:
        """Change a model of `dynamics.dynamics_spec`; nothing but the points is left out."""
        robot = robot_body_ids(model)
        model.body_mass[robot] *= self.masses
        model.body_inertia[robot] *= self.masses[:, None]
        base = model.body("base").id
        model.body_mass[base] += self.payload
        model.opt.gravity[:] = self.gravity
        model.dof_frictionloss[6:] = self.friction.ravel()
        model.dof_damping[6:] = self.damping.ravel()
        for limb, factor in enumerate(self.stiffness):
            grasp = model.actuator_group == limb + 1
            model.actuator_biasprm[grasp] *= factor
        mujoco.mj_setConst(model, mujoco.MjData(model))

    @property
    def turned(self) -> Rotation:
        """How points are turned against the map."""
        return Rotation.from_rotvec(self.point_turns)


def robot_body_ids(model: mujoco.MjModel) -> IntArray:
    """Indices of the robot's bodies."""
    indices: IntArray = np.flatnonzero(model.body_rootid == model.body("base").id)
    return indices


def _directions(rng: np.random.Generator, count: int) -> Array:
    """Unit vectors, all directions alike, shape (count, 3)."""
    drawn = rng.normal(size=(count, 3))
    unit: Array = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
    return unit


NONE = Disturbances()
"""No disturbance but the noise of the gripper's sensor."""

ALL = Disturbances(
    friction=3.0,
    damping=1.0,
    encoder_bias=float(np.deg2rad(0.5)),
    encoder_noise=float(np.deg2rad(0.002)),
    speed_noise=0.001,
    delay=0.002,
    acceleration=1e-3,
    payload=5.0,
    masses=0.2,
    stiffness=3.0,
    point_position=0.005,
    point_angle=float(np.deg2rad(1.0)),
)
"""All of them at once, at the sizes that are studied."""

DISTURBANCES = {"none": NONE, "all": ALL}
"""Disturbances by name."""

Disturbances.named = DISTURBANCES
