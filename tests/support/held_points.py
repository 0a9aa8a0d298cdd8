"""Where limbs hold, by another library's forward kinematics."""

import numpy as np
from scipy.spatial.transform import Rotation


def assert_held(robot, grasp_map, stance, configuration, flange, atol=1e-7):
    """Each limb has its tool at its point and along the normal.

    Args:
        robot: The robot.
        grasp_map: The map of the points.
        stance: Point of each limb, by name or index; None for a limb that holds none.
        configuration: Position and quaternion of the base, joint angles of the limbs.
        flange: What gives the flange in the limb base frame, shape (4, 4), of joint angles.
        atol: How far off place [m] and axis may be.
    """
    position, quaternion, joints = configuration
    base = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    for i, point in enumerate(stance):
        if point is None:
            continue
        index, frame = grasp_map.index(point), flange(joints[i])
        mount = base @ robot.mount_rotations[i]
        tip = frame[:3, 3] + robot.tool_length * frame[:3, 2]
        world = position + base @ robot.mount_positions[i] + mount @ tip
        np.testing.assert_allclose(world, grasp_map.positions[index], atol=atol)
        np.testing.assert_allclose(mount @ frame[:3, 2], -grasp_map.normals[index], atol=atol)
