"""Lines in joint space of a robot of two limbs, and where it is on them."""

import numpy as np
from scipy.spatial.transform import Rotation

from mlivr_gym.collisions.joint_lines import RESTING
from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.robot.link_frames import inverse, link_frames, rigid


def flange_in_body(robot, limb, q):
    """Frame of a limb's flange in the body frame at joint angles (6,), shape (4, 4)."""
    mount = rigid(robot.mount_rotations[limb], robot.mount_positions[limb])
    return mount @ link_frames(robot.every_limb[limb], q)[6]


def carried(robot, leader, grasp, q):
    """Frame of the base in the world of a limb that holds a flange frame (4, 4)."""
    return grasp @ inverse(flange_in_body(robot, leader, q))


def line_scratch(joints, leader=RESTING, frame=None, **compared):
    """A line to be checked, a row of `LineScratch`.

    Args:
        joints: Joint angles of all limbs at the start and at the end, shape (2, N, 6).
        leader: Limb that carries the base.
        frame: Frame in the world of its flange, or of the base while it rests, shape (4, 4).
        compared: Fields of `Compared`.
    """
    scratch = LineScratch.row()
    line = scratch["line"]
    frame = np.eye(4) if frame is None else frame
    where = line["base" if leader < 0 else "grasp"]
    line["leader"], where["position"], where["rotation"] = leader, frame[:3, 3], frame[:3, :3]
    for name, at in zip(("first", "last"), joints, strict=True):
        line[name]["q"][: len(at)] = at
    scratch["compared"]["first"], scratch["compared"]["second"] = 0, -1
    for name, value in compared.items():
        scratch["compared"][name] = value
    return scratch


def configurations(robot, joints, leader, frame, shares):
    """Base position, quaternion w, x, y, z and joint angles at shares of a line."""
    found = []
    for s in shares:
        q = joints[0] + s * (joints[1] - joints[0])
        base = frame if leader < 0 else carried(robot, leader, frame, q[leader])
        turned = Rotation.from_matrix(base[:3, :3]).as_quat(scalar_first=True)
        found.append((base[:3, 3], turned, q))
    return found
