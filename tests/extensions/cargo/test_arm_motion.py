"""Lines along the normal of a point, and paths between joint angles, of one limb at rest."""

import numpy as np
import pinocchio
from pinocchio_robots import pinocchio_robot

from mlivr_gym.extensions.cargo.arm_motion import LimbScene
from mlivr_gym.kinematics import grasp_rows


def test_each_line_from_a_point_begins_there_and_lies_along_its_normal(checked_graph, walk):
    """By Pinocchio, to the 0.2 mm that a departure may be off."""
    position, quaternion, joints = walk.configuration(0)
    robot, grasp_map = checked_graph.robot, checked_graph.grasp_map
    scene, found = LimbScene(robot, 0, None, (grasp_map, ())), 0
    scene.stand(position, quaternion, joints)
    model = pinocchio_robot(robot)
    data, tip = model.createData(), model.getFrameId("grasp0")
    q = np.concatenate([position, np.roll(quaternion, -1), joints.ravel()])
    for k in np.linalg.norm(grasp_map.positions - position, axis=1).argsort()[:60]:
        point, (rail, _, normal) = grasp_map.positions[k], grasp_map.rotations[k].T
        for line in scene.departures(grasp_rows(point, normal, rail, robot.tool_length)[()]):
            heights = np.linspace(0.0, robot.lift, len(line))
            for height, angles in zip(heights, line, strict=True):
                q[7:13] = angles
                pinocchio.framesForwardKinematics(model, data, q)
                place = point + height * normal
                np.testing.assert_allclose(data.oMf[tip].translation, place, atol=1e-6)
            assert (line >= robot.every_limb[0].windows[:, 0]).all()
            assert (line <= robot.every_limb[0].windows[:, 1]).all()
            found += 1
    assert found > 10
