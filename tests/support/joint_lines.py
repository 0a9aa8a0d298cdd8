"""Lines in joint space of a robot, and where it is on them while its base rests."""

from scipy.spatial.transform import Rotation

from mlivr_gym.collisions.places import LineScratch
from mlivr_gym.robot.limb import link_frames
from mlivr_gym.robot.rigid import rigid


def flange_in_body(robot, limb, q):
    """Frame of a limb's flange in the body frame at joint angles (6,), shape (4, 4)."""
    mount = rigid(robot.mount_rotations[limb], robot.mount_positions[limb])
    return mount @ link_frames(robot.every_limb[limb], q)[6]


def line_scratch(joints, frame=None, **compared):
    """A line to be checked, a row of `LineScratch`.

    Args:
        joints: Joint angles of all limbs at the start and at the end, shape (2, N, 6).
        frame: Frame of the base in the world while it rests, shape (4, 4); None if it moves.
        compared: Fields of `Compared`.
    """
    scratch = LineScratch.row()
    line = scratch["line"]
    line["moves"] = frame is None
    if frame is not None:
        line["base"]["position"], line["base"]["rotation"] = frame[:3, 3], frame[:3, :3]
    for name, at in zip(("first", "last"), joints, strict=True):
        line[name]["q"][: len(at)] = at
    scratch["compared"]["first"], scratch["compared"]["second"] = 0, -1
    for name, value in compared.items():
        scratch["compared"][name] = value
    return scratch


def configurations(joints, frame, shares):
    """Base position, quaternion w, x, y, z and joint angles at shares of a line at rest."""
    turned = Rotation.from_matrix(frame[:3, :3]).as_quat(scalar_first=True)
    return [(frame[:3, 3], turned, joints[0] + s * (joints[1] - joints[0])) for s in shares]
