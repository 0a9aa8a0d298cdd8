"""Depth cameras on body and grippers, simulated by ray casting, so that no GL library is needed.

One pinhole camera looks out of each corner of the body, along its diagonal. There the limbs, which
are mounted on the faces, hide least. Four look out of each gripper, sideways and forwards, and see
what the limbs hide from the body, and the far sides of things. Rays that hit the robot are left
out, as a robot filters its own links from a depth image by its joint angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Annotated, ClassVar

import numpy as np

from mlivr_gym.arguments import InstanceOf, Validators, checked
from mlivr_gym.arrays import Array
from mlivr_gym.extensions.closed_loop.hits import NOISE
from mlivr_gym.robot import RobotSpec
from mlivr_gym.schema import Integer, Numbers, Tuples
from mlivr_gym.simulation.disturbances import robot_body_ids
from mlivr_gym.simulation.gl import mujoco
from mlivr_gym.simulation.parameters import ParameterSet

CORNERS = np.array(list(product((1.0, -1.0), repeat=3)))
"""Signs of the coordinates of the corners of the body in its frame, shape (8, 3)."""

LENS_OFFSET = 0.01
"""Distance of a camera from each of the three faces that meet in its corner, or from the side of
its gripper [m]."""

SIDES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Directions from the axis of a gripper, z, to its cameras, shape (4, 3)."""

GRIPPER_AXES = SIDES * np.cos(np.pi / 6.0) + np.array([0.0, 0.0, np.sin(np.pi / 6.0)])
"""Their optical axes: sideways, and 30 degrees forwards, shape (4, 3)."""

GIVEN: Validators = {
    "axes": Numbers((None, 3)),
    "model": InstanceOf(mujoco.MjModel),
    "data": InstanceOf(mujoco.MjData),
    "robot": InstanceOf(RobotSpec),
    "rng": InstanceOf(np.random.Generator),
}
"""Validators of the arguments."""


@dataclass(frozen=True)
class DepthCamera(ParameterSet):
    """Parameters of the cameras on the corners of the body and on the grippers.

    Examples
    --------
    >>> DepthCamera(max_range=2.0).rays().shape
    (8, 6400, 3)
    """

    label: ClassVar[str] = "camera"

    pixels: Annotated[int, Integer(2, 1000)] = 80
    """Number of pixels of an image along each side."""
    field_of_view: Annotated[float, Tuples((), 1e-3, 3.0, "rad")] = float(2.0 * np.pi / 3.0)
    """Angle between opposite sides of an image [rad]."""
    max_range: Annotated[float, Tuples((), 1e-3, 1e3, "m")] = 3.0
    """Largest distance that is measured [m]."""
    noise: Annotated[float, NOISE] = 0.003
    """Standard deviation of a distance [m]."""
    period: Annotated[float, Tuples((), 0.01, 1e3, "s")] = 0.5
    """Time between two looks during a step [s]."""

    @checked(GIVEN)
    def rays(self, axes: Array = CORNERS) -> Array:
        """Return unit vectors of the rays of k cameras, shape (k, p^2, 3).

        Their optical axes, shape (k, 3), none of them along z, are by default those of the cameras
        on the body. Raises a `SettingError` if one is not finite.
        """
        half = np.tan(0.5 * self.field_of_view)
        centres = (np.arange(self.pixels) + 0.5) / self.pixels * 2.0 - 1.0
        u, v = half * np.stack(np.meshgrid(centres, centres, indexing="ij")).reshape(2, -1, 1)
        forward = axes[:, None] / np.linalg.norm(axes, axis=1)[:, None, None]
        right = np.cross(forward, np.array([0.0, 0.0, 1.0]))
        right /= np.linalg.norm(right, axis=2)[..., None]
        rays = forward + u * right + v * np.cross(forward, right)
        return np.asarray(rays / np.linalg.norm(rays, axis=2, keepdims=True))

    @checked(GIVEN)
    def measure(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        robot: RobotSpec,
        rng: np.random.Generator,
    ) -> Array:
        """Return the hits: the surface points that the cameras measure around a simulated robot.

        They are positions in the module frame [m], shape (k, 3). A ray that hits nothing within the
        range gives none. The generator makes the noise. Raises a `SettingError` if an argument is
        of another type.
        """
        of_robot, hits = np.isin(model.geom_bodyid, robot_body_ids(model)), []
        for position, rays in self._images(model, data, robot):
            geom, distance = np.full(len(rays), -1, dtype=np.int32), np.zeros(len(rays))
            mujoco.mj_multiRay(
                model, data, position, rays.ravel(), None, True, -1, geom, distance, None,
                len(rays), self.max_range,
            )  # fmt: skip
            hit = (geom >= 0) & (distance <= self.max_range)
            hit[hit] = ~of_robot[geom[hit]]
            distance = distance[hit] + self.noise * rng.standard_normal(int(hit.sum()))
            hits.append(position + distance[:, None] * rays[hit])
        return np.concatenate(hits)

    def _images(
        self, model: mujoco.MjModel, data: mujoco.MjData, robot: RobotSpec
    ) -> Iterator[tuple[Array, Array]]:
        """Yield the position of each camera [m] and its rays (p^2, 3), in the module frame."""
        base = data.body("base")
        rotation = base.xmat.reshape(3, 3)
        for corner, image in zip(CORNERS, self.rays(), strict=True):
            lens = corner * (0.5 * np.array(robot.body_edges) + LENS_OFFSET)
            yield base.xpos + rotation @ lens, image @ rotation.T
        images = self.rays(GRIPPER_AXES)
        for limb in range(robot.limbs):
            site = model.site(f"limb{limb}/grasp")
            gripper = model.body(f"limb{limb}/gripper")
            parts = np.isin(model.geom_bodyid, (gripper.id, int(gripper.parentid[0])))
            radius = float(model.geom_size[parts, 0].max()) + LENS_OFFSET
            rotation, position = data.site_xmat[site.id].reshape(3, 3), data.site_xpos[site.id]
            flange = position - robot.tool_length * rotation[:, 2]
            for side, image in zip(SIDES, images, strict=True):
                yield flange + radius * rotation @ side, image @ rotation.T
