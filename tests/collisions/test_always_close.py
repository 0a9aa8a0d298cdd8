"""Links that are close in every posture: balls about joint axes keep their distance."""

from dataclasses import replace

import numpy as np
import pytest
from robot_texts import one_arm, written

from mlivr_gym import Capsule, Limb, RobotSpec, robot_spec, stance_graph
from mlivr_gym.collisions.always_close import always_close_links
from mlivr_gym.errors import RobotError
from mlivr_gym.robot.capsules import default_capsules
from mlivr_gym.robot.limb_dynamics import ARMS, arm_limb

CLEARANCE = 0.02


def with_balls(gap):
    """Two UR5e with a ball on axis 4 and one at the wrist point, whose surfaces are a gap apart."""
    robot = robot_spec("mlivr2")
    # The lengths a3, d4 and d5 of the maker's DH table.
    radius = 0.5 * (np.hypot(0.1333, 0.0997) - gap)
    elbow, here = (-0.3922, 0.0, 0.0), (0.0, 0.0, 0.0)
    balls = Capsule("forearm", elbow, elbow, radius), Capsule("wrist_2", here, here, radius)
    return replace(robot, capsules=balls)


@pytest.mark.parametrize(("gap", "pairs"), [(0.0199, (("forearm", "wrist_2"),)), (0.0201, ())])
def test_balls_about_joint_axes_are_close_at_every_angle_or_at_none(gap, pairs):
    robot = with_balls(gap)
    assert always_close_links(robot, CLEARANCE) == pairs
    assert always_close_links(replace(robot, apart=(("forearm", "wrist_2"),)), CLEARANCE) == ()


@pytest.mark.parametrize("name", ["mlivr2", "mlivr2-ur3e", "mlivr2-iiwa", "mlivr3", "ssrms2"])
def test_robots_that_ship_have_none(name):
    assert always_close_links(robot_spec(name), CLEARANCE) == ()


def test_a_robot_without_a_stance_is_told_which_links_and_what_would_help(small_map):
    words = (
        r"touch the robot itself: forearm and wrist_2 of a limb are within 0.02 m of each other in "
        r"every posture; give a smaller clearance, .* or apart=\[\('forearm', 'wrist_2'\)\] "
        r"\(--allow-touching\)"
    )
    with pytest.raises(RobotError, match=words) as caught:
        stance_graph(small_map, with_balls(0.0))
    assert "\n" not in str(caught.value)
    robot = replace(with_balls(0.0), apart=(("forearm", "wrist_2"),))
    assert len(stance_graph(small_map, robot)) > 0


def test_limbs_that_are_mounted_in_one_place_are_named():
    """A ball at each shoulder, whose middle no joint moves."""
    robot = robot_spec("mlivr2")
    balls = tuple(Capsule("upper_arm", (0.0, 0.0, z), (0.0, 0.0, z), 0.03) for z in (0.0, 0.1))
    first = replace(robot.mounted[0], limb=None, capsules=None, dynamics=None, visuals=None)
    x, y, z = first.position
    beside = replace(first, position=(x, y, z + 0.05))
    near = replace(robot, mounts=(first, beside), capsules=balls)
    assert ("limb0/upper_arm", "limb1/upper_arm") in always_close_links(near, CLEARANCE)
    assert always_close_links(replace(robot, capsules=balls), CLEARANCE) == ()


def test_an_arm_from_a_file_stands_so_that_its_long_upper_arm_can_leave_the_body(tmp_path):
    """One capsule of 0.2 m about joint 2 and along the arm; joint 2 is 0.1807 m above the mount."""
    head, rest = one_arm().split('<link name="link2">')
    ball = '<origin xyz="0 0 0"/><geometry><sphere radius="0.03"/>'
    tube = ball.replace('<sphere radius="0.03"/>', '<capsule radius="0.2" length="0.5"/>')
    tube = tube.replace('xyz="0 0 0"', 'xyz="-0.25 0 0" rpy="0 1.5707963 0"')
    text = f'{head}<link name="link2">{rest.replace(ball, tube, 1)}'
    text = text.replace('<robot name="arm">', '<robot name="arm" version="1.2">')
    robot = RobotSpec.from_urdf(written(tmp_path, text))
    assert robot.mount_radius == pytest.approx(0.1 + 0.2 + 0.03 - 0.1807, abs=1e-3)
    assert not always_close_links(robot, CLEARANCE)
    nearer = replace(robot, mount_radius=0.1)
    assert always_close_links(nearer, CLEARANCE) == (("body", "upper_arm"),)


@pytest.mark.parametrize("scale", [0.6, 1.0, 1.5])
@pytest.mark.parametrize("arm", ARMS)
def test_simple_shapes_along_the_links_of_an_arm_are_not_always_close(arm, scale):
    """Lengths of the makers, and others, so that no arm has capsules that were measured."""
    origins = scale * 1.01 * np.array(arm_limb(arm).origins)
    limb = Limb(origins, arm_limb(arm).quaternions)
    robot = RobotSpec(limb=limb)
    assert default_capsules(limb, robot.tool_length)[1].link == "upper_arm"
    assert always_close_links(robot, CLEARANCE) == ()
