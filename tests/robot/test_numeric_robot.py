"""Robots whose arms have no closed form, from the file to the walk, and what is refused of them."""

from dataclasses import replace

import numpy as np
import pytest
from numeric_arms import LIMBS, frames_of
from robot_texts import KR16, one_arm, written

from mlivr_gym import RobotSpec, jem_map, stance_graph
from mlivr_gym.errors import RobotError
from mlivr_gym.motion.plan_checks import check_motion
from mlivr_gym.planners import Planner
from mlivr_gym.robot.from_file import read_robot
from mlivr_gym.simulation.execution import execute

FIGURES = tuple((3.1, torque, mass) for torque, mass in zip(
    (50, 50, 32, 32, 32, 20), (2.2, 1.7, 1.4, 1.1, 1.3, 0.2), strict=True,
))  # fmt: skip
"""Limit, torque and mass of each joint, about those of an xArm 6."""


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    text = one_arm(frames=frames_of("xarm6"), figures=FIGURES)
    folder = tmp_path_factory.mktemp("xarm6")
    return RobotSpec.from_urdf(written(folder, text), capsules="ur5e")


def test_a_robot_solved_numerically_walks_in_mujoco(robot):
    """Over points around some of two walls and the deck, in contact with nothing there."""
    jem = jem_map()
    some = jem.positions[[jem.index(point) for point in ("A2a:0", "A3a:5", "D2a:2", "F3a:1")]]
    near = np.linalg.norm(jem.positions[:, None] - some, axis=2).min(axis=1) < 0.5
    graph = stance_graph(jem.subset(near), robot)
    plan = Planner(graph).plan(("A2a:0", "A3a:5"), (2.499, -0.576, -0.298), "steps").unwrap()
    assert len(plan.steps) >= 2
    check_motion(plan.query, plan.world, plan.motion, graph.grasp_map)
    execution = execute(graph, plan)
    assert execution.failure is None
    assert len(execution.captures) == len(plan.steps)


def test_an_offset_in_the_wrist_leaves_the_closed_form(tmp_path):
    frames = [frame.copy() for frame in KR16]
    for frame in frames[5:]:
        frame[:3, 3] += (0.0, 0.0, 0.05)
    for some, names in ((KR16, "closed form"), (frames, "of no closed form, solved numerically")):
        source = read_robot(written(tmp_path, one_arm(frames=some))).fields["source"]
        assert (names in source) == (some is frames)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"origins": ((0.1, 0.0, 0.0), *LIMBS["xarm6"].origins[1:])},
         r"origins\[0\] and its quaternion put joint 1 beside the z axis"),
        ({"quaternions": ((0.0, 1.0, 0.0, 0.0), *LIMBS["xarm6"].quaternions[1:])},
         r"origins\[0\] and its quaternion put joint 1 beside the z axis of the base, or against"),
        ({"quaternions": (*LIMBS["xarm6"].quaternions[:5], (0.5, 0.0, 0.0, 0.0))},
         r"quaternions\[5\] is .* of length 0.5; it must be 1"),
        ({"quaternions": (*LIMBS["xarm6"].quaternions[:5], (1.0, 0.0, 0.0, 0.0))},
         r"quaternions make the last two axes that move parallel"),
        ({"origins": ((0.0, 0.0, 0.2), *((0.0, 0.0, 0.0),) * 5)}, "singular in every posture"),
        ({"joint_limits": ((-1.0, 1.0),) * 5}, "joint_limits"),
    ],
)  # fmt: skip
def test_frames_that_make_no_arm_are_refused(fields, words):
    with pytest.raises(RobotError, match=words) as caught:
        replace(LIMBS["xarm6"], **fields)
    assert "\n" not in str(caught.value)
