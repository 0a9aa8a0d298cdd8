"""Disturbances: a simulated robot and module that differ from the model of the controller.

`DisturbanceRanges` has the range of each parameter, and its method `draw` draws the values of one
`Disturbance` from them. `ALL` has the ranges that are studied. They are assumptions in the order of
magnitude of published values: joint friction of the UR5e is identified by Clochiatti, Scalera,
Boscariol and Gasparetto, "Electro-mechanical modeling and identification of the UR5 e-series
robot", Robotica 42, 2024; accelerations in the ISS are described by McPherson, Hrovat, Kelly and
Keller, "Researcher's Guide to: International Space Station Acceleration Environment", NASA, 2015.
For encoders, points and grasps of this robot no values are published.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, ClassVar

import numpy as np

from mlivr_gym.arrays import Array, IntArray
from mlivr_gym.schema import Tuples
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.parameters import ParameterSet

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity, 1 g [m/s^2]."""


@dataclass(frozen=True)
class DisturbanceRanges(ParameterSet):
    """Ranges from which disturbances are drawn; 0 (1 for `stiffness`) is the controller's model.

    Examples
    --------
    >>> DisturbanceRanges.of("all").payload
    5.0
    """

    friction: Annotated[float, Tuples((), 0.0, 1e3, "N m")] = 0.0
    """Upper bound of the Coulomb friction of each joint, uniform from 0 [N m]."""
    damping: Annotated[float, Tuples((), 0.0, 1e3, "N m s/rad")] = 0.0
    """Upper bound of the viscous friction of each joint, uniform from 0 [N m s/rad]."""
    encoder_bias: Annotated[float, Tuples((), 0.0, 1.0, "rad")] = 0.0
    """Bound of the constant error of each encoder, uniform in plus and minus this [rad]."""
    encoder_noise: Annotated[float, Tuples((), 0.0, 1.0, "rad")] = 0.0
    """Standard deviation of each encoder reading [rad]."""
    speed_noise: Annotated[float, Tuples((), 0.0, 10.0, "rad/s")] = 0.0
    """Standard deviation of each reading of a joint velocity [rad/s]."""
    delay: Annotated[float, Tuples((), 0.0, 0.1, "s")] = 0.0
    """Time from a reading to the torque computed from it [s]."""
    acceleration: Annotated[float, Tuples((), 0.0, 1.0, "g")] = 0.0
    """Magnitude of the residual acceleration, in a direction drawn for each walk [g]."""
    payload: Annotated[float, Tuples((), 0.0, 1e4, "kg")] = 0.0
    """Upper bound of a mass at the centre of the body, uniform from 0 [kg]."""
    masses: Annotated[float, Tuples((), 0.0, 0.9)] = 0.0
    """Relative bound of the error of mass and inertia of each body, uniform."""
    stiffness: Annotated[float, Tuples((), 1.0, 100.0)] = 1.0
    """Largest factor of stiffness and damping of each grasp, log-uniform from its inverse; 1 for
    none."""
    point_position: Annotated[float, Tuples((), 0.0, 1.0, "m")] = 0.0
    """Radius of the ball in which each point is displaced, uniform [m]."""
    point_angle: Annotated[float, Tuples((), 0.0, 1.0, "rad")] = 0.0
    """Upper bound of the angle by which each point is rotated about a random axis, uniform from 0
    [rad]."""
    sensor_position: Annotated[float, Tuples((), 0.0, 1.0, "m")] = 0.001
    """Standard deviation of the gripper sensor in each position component [m]."""
    sensor_angle: Annotated[float, Tuples((), 0.0, 1.0, "rad")] = float(np.deg2rad(0.5))
    """Standard deviation of the gripper sensor in each rotation component [rad]."""
    refusal: Annotated[float, Tuples((), 0.0, 0.95)] = 0.0
    """Probability that an attempt to grasp fails although the gripper is at its point."""

    label: ClassVar[str] = "disturbances"

    def draw(self, seed: int, body_count: int, limbs: int, points: int) -> Disturbance:
        """Draw the values for one robot and module.

        Each parameter has a random stream of its own, so its draw does not depend on the other
        ranges. The map has m `points`, the MuJoCo model of the robot `body_count` bodies.
        """
        names = [field.name for field in fields(self)]
        seeds = np.random.SeedSequence(seed).spawn(len(names))
        streams = dict(zip(names, map(np.random.default_rng, seeds), strict=True))
        shape = (limbs, 6)
        ball = streams["point_position"]
        offsets = _directions(ball, points) * ball.uniform(size=(points, 1)) ** (1.0 / 3.0)
        turns = _directions(streams["point_angle"], points)
        turns *= streams["point_angle"].uniform(size=(points, 1))
        grasps = streams["stiffness"].uniform(-1.0, 1.0, limbs)
        return Disturbance(
            seed=seed,
            ranges=self,
            friction=self.friction * streams["friction"].uniform(size=shape),
            damping=self.damping * streams["damping"].uniform(size=shape),
            encoder_bias=self.encoder_bias * streams["encoder_bias"].uniform(-1.0, 1.0, shape),
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
    """Drawn values of the disturbances of one robot and module."""

    seed: int
    """Seed of the draw, and of the noise of the readings."""
    ranges: DisturbanceRanges
    """Ranges from which it was drawn."""
    friction: Array
    """Coulomb friction of each joint, shape (N, 6) [N m]."""
    damping: Array
    """Viscous friction of each joint, shape (N, 6) [N m s/rad]."""
    encoder_bias: Array
    """Encoder reading minus joint angle, shape (N, 6) [rad]."""
    gravity: Array
    """Residual acceleration in the world, shape (3,) [m/s^2]."""
    payload: float
    """Mass at the centre of the body [kg]."""
    masses: Array
    """Factor of mass and inertia of each body, in the order of the robot's bodies."""
    stiffness: Array
    """Factor of stiffness and damping of each grasp, shape (N,)."""
    point_offsets: Array
    """Displacement of each point from its position in the map, shape (m, 3) [m]."""
    point_turns: Array
    """Rotation vector of each point relative to the map, shape (m, 3) [rad]."""

    def apply(self, model: mujoco.MjModel) -> None:
        """Apply the disturbance to a model of `dynamics.dynamics_spec`.

        Displaced points, encoders and delay are not part of the model; `Grippers` and
        `JointController` apply them.
        """
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


def robot_body_ids(model: mujoco.MjModel) -> IntArray:
    """Return the indices of the robot's bodies in a model."""
    indices: IntArray = np.flatnonzero(model.body_rootid == model.body("base").id)
    return indices


def _directions(rng: np.random.Generator, count: int) -> Array:
    """Draw unit vectors, uniform over the sphere, shape (count, 3)."""
    drawn = rng.normal(size=(count, 3))
    unit: Array = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
    return unit


ALL = DisturbanceRanges(
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
"""All disturbances together, in the ranges that are studied."""

DISTURBANCES = {"none": DisturbanceRanges(), "all": ALL}
"""Ranges of disturbances by name; without any, the sensor of a gripper has its noise alone."""

DisturbanceRanges.presets = DISTURBANCES
