"""Messages have the layout of ROS 2, and what does not fit is refused in one line."""

import struct

import numpy as np
import pytest

from mlivr_gym.closed_loop.ros_messages import point_cloud_message, points_of_message
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.trajectory_files import joint_trajectory_message
from mlivr_gym.simulation.timing import step_trajectory

POINTS = np.array([[1.0, -2.0, 0.5], [3.25, 0.0, -1.0]])


def organised(is_dense=False, bigendian=True):
    """A cloud of 2 rows of 2 points with a colour between y and z, packed number by number."""
    order, data = ">" if bigendian else "<", b""
    for k, (x, y, z) in enumerate([*POINTS, [np.nan, 0.0, 0.0], [7.0, 8.0, 9.0]]):
        data += struct.pack(f"{order}ffBxxxd", x, y, 200, z)
        data += b"pad!" * (k % 2)
    fields = [
        {"name": "x", "offset": 0, "datatype": 7, "count": 1},
        {"name": "y", "offset": 4, "datatype": 7, "count": 1},
        {"name": "rgb", "offset": 8, "datatype": 2, "count": 1},
        {"name": "z", "offset": 12, "datatype": 8, "count": 1},
    ]
    return {
        "header": {"stamp": {"sec": 3, "nanosec": 500_000_000}, "frame_id": "module"},
        "height": 2, "width": 2, "fields": fields, "is_bigendian": bigendian, "point_step": 20,
        "row_step": 44, "data": list(data), "is_dense": is_dense,
    }  # fmt: skip


@pytest.mark.parametrize("bigendian", [True, False])
def test_points_are_read_wherever_they_lie(bigendian):
    points = points_of_message(organised(bigendian=bigendian))
    assert points == pytest.approx(np.array([*POINTS, [7.0, 8.0, 9.0]]))


def test_a_cloud_that_is_written_is_read_again():
    message = point_cloud_message(POINTS, time=1.25)
    assert message["header"]["stamp"] == {"sec": 1, "nanosec": 250_000_000}
    assert struct.unpack("<6f", message["data"]) == tuple(POINTS.ravel())
    assert points_of_message(message, now=1.5, latest=0.3) == pytest.approx(POINTS)
    assert points_of_message(point_cloud_message(POINTS[:0], 0.0)).shape == (0, 3)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"header": {"stamp": {"sec": 3, "nanosec": 0}, "frame_id": "map"}}, "frame 'map'"),
        ({"header": {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "module"}}, "3 s old"),
        ({"is_dense": True}, "point 2 .*not finite"),
        ({"data": [0] * 87}, "87 bytes"),
        ({"point_step": 30}, "30 bytes"),
        ({"fields": [{"name": "x", "offset": 0, "datatype": 7, "count": 1}]}, "no field 'y'"),
        ({"fields": [{"name": "x", "offset": 0, "datatype": 9, "count": 1}]}, "datatype 9"),
    ],
)
def test_a_cloud_that_does_not_fit_is_refused(changed, named):
    with pytest.raises(SettingError, match=named) as caught:
        points_of_message(organised() | changed, now=4.0, latest=1.0)
    assert "\n" not in str(caught.value)


def test_a_message_without_a_field_is_refused():
    message = organised()
    del message["row_step"]
    with pytest.raises(SettingError, match="row_step"):
        points_of_message(message)


def test_a_trajectory_has_the_fields_of_its_message(checked_graph, plan):
    trajectory = step_trajectory(checked_graph, plan, 0, Durations()).at(np.arange(0, 4000, 500))
    message = joint_trajectory_message(trajectory)
    assert list(message) == ["header", "joint_names", "points"]
    assert message["joint_names"][:2] == ["limb0/joint1", "limb0/joint2"]
    assert len(message["points"]) == len(trajectory.times)
    for k, point in enumerate(message["points"]):
        assert list(point) == [
            "positions", "velocities", "accelerations", "effort", "time_from_start"
        ]  # fmt: skip
        assert point["positions"] == trajectory.joint_positions[k].ravel().tolist()
        assert len(point["velocities"]) == len(message["joint_names"])
        time = point["time_from_start"]
        assert time["sec"] + 1e-9 * time["nanosec"] == pytest.approx(trajectory.times[k])
