"""What grippers may touch, against the corners of boxes."""

import numpy as np
import pytest
from coal_ruler import behind
from scipy.spatial.transform import Rotation

from mlivr_gym import Box, robot_spec
from mlivr_gym.simulation.dynamics import gripper_bit
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.world.boxes import BOX, scene_name


def boxes_about(points, normals, rng):
    """Turned boxes whose tops are flush with the surface of a point, below it, above it."""
    boxes = []
    for k, (point, normal) in enumerate(zip(points, normals, strict=True)):
        turn, half = Rotation.random(None, rng).as_matrix(), rng.uniform(0.01, 0.2, 3)
        top = np.abs(normal @ turn) @ half
        out = (1.9e-3, 2.1e-3, -0.1, 0.1)[k % 4]
        aside = np.cross(normal, rng.normal(size=3)) * 0.1
        centre = point + aside + (out - top) * normal
        boxes.append(Box(f"near{k}", "obstacle", tuple(centre), tuple(half), Box.rows(turn)))
    return boxes


@pytest.mark.parametrize("limb", [0, 1])
def test_a_gripper_meets_every_box_but_those_of_which_no_corner_stands_out(jem, limb):
    """Out of the surface of one point or of another; what the other gripper meets stays."""
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(jem), 12, replace=False)
    near = boxes_about(jem.positions[chosen], jem.normals[chosen], rng)
    simulation = Simulation(jem, robot_spec("mlivr2"), obstacles=near)
    model, boxes, bit = simulation.model, [*jem.boxes, *near], gripper_bit(limb)
    geoms = [model.geom(scene_name(BOX, box.id)).id for box in boxes]
    for points in ([], *([point] for point in chosen), chosen[:2].tolist()):
        before = model.geom_contype.copy()
        simulation._grippers.set_contacts(limb, points)
        met = model.geom_contype[geoms] & bit != 0
        free = np.array(
            [any(behind(box, jem.positions[p], jem.normals[p]) for p in points) for box in boxes]
        )
        assert (met == ~free).all()
        assert free.any() == bool(points)
        assert ((model.geom_contype ^ before) & ~bit == 0).all()
