"""Links that are close in every posture: balls about joint axes keep their distance."""

from dataclasses import replace

import numpy as np
import pytest

from mlivr_gym import Capsule, robot_spec, stance_graph
from mlivr_gym.collisions.always_close import always_close_links
from mlivr_gym.errors import RobotError

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
