"""Messages have the layout of ROS 2, and what does not fit is refused in one line."""

import copy
import struct
from functools import reduce
from operator import getitem

import numpy as np
import pytest
from fuzz import bounded, few, given_values
from hypothesis import given
from hypothesis import strategies as st

from mlivr_gym.closed_loop.ros_messages import point_cloud_message, points_of_message
from mlivr_gym.errors import MlivrError, SettingError

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


def with_field(number, **changed):
    """The organised cloud with another description of one of its fields."""
    fields = [dict(field) for field in organised()["fields"]]
    fields[number] |= changed
    return {"fields": fields}


def header(sec=3, nanosec=0, frame="module"):
    return {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}}


X = {"name": "x", "offset": 0, "datatype": 7, "count": 1}


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        (header(frame="map"), "header.frame_id is 'map'; it must be 'module'"),
        (header(sec=1), "stamp is 3 s before .* at most 1 s"),
        (header(sec=5), "stamp is 1 s after .* at most 0.05 s"),
        ({"is_dense": True}, "is_dense is true, but point 2 is .*nan"),
        ({"data": [0] * 87}, r"data has 87 bytes; .* 2 \* 44 = 88"),
        ({"data": [0] * 87 + [256]}, "data is .*from 0 to 255"),
        ({"row_step": 39, "data": [0] * 78}, r"row_step is 39; .* 2 \* 20 = 40"),
        ({"point_step": 30}, "row_step is 44; .*60"),
        ({"point_step": 19}, r"fields\[3\].offset is 12; 8 bytes .* point_step, 19"),
        ({"fields": [X]}, "fields has 0 fields 'y'"),
        ({"fields": [X, X]}, "fields has 2 fields 'x'"),
        (with_field(0, datatype=9), r"fields\[0\].datatype is 9; .*1 to 8"),
        (with_field(3, count=2), r"fields\[3\].count is 2; it must be 1"),
    ],
)
def test_a_cloud_that_does_not_fit_is_refused(changed, named):
    with pytest.raises(SettingError, match=rf"message\..*{named}") as caught:
        points_of_message(organised() | changed, now=4.0, latest=1.0)
    assert str(caught.value).isprintable()


def test_the_age_of_a_cloud_counts_only_where_the_time_is_given():
    cloud = point_cloud_message(POINTS, time=1e9)
    assert len(points_of_message(cloud)) == len(POINTS)
    assert len(points_of_message(cloud, now=2e9)) == len(POINTS)
    assert len(points_of_message(cloud, now=1e9 - 0.04, latest=0.0)) == len(POINTS)
    with pytest.raises(SettingError, match="after the present time"):
        points_of_message(cloud, now=0.0)
    with pytest.raises(SettingError, match="before the present time"):
        points_of_message(cloud, now=1e9 + 0.3, latest=0.2)
    with pytest.raises(SettingError, match="now is not given"):
        points_of_message(cloud, latest=0.2)


def read(message, **options):
    """Read a message, whose error may be one line that names a field or an argument."""
    try:
        with bounded():
            points = points_of_message(message, **options)
    except MlivrError as error:
        told = str(error)
        assert any(name in told for name in ("message", *options))
        assert told.isprintable()
        assert len(told) < 1500
        return None
    assert points.shape == (len(points), 3)
    assert np.isfinite(points).all()
    return points


def places(data, before=()):
    """The path to every value in nested data."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield (*before, key)
        if isinstance(value, (dict, list)):
            yield from places(value, (*before, key))


WHOLE = organised() | {"data": bytes(organised()["data"])}


@pytest.mark.parametrize("place", list(places(WHOLE)))
def test_values_of_every_type_in_every_place_give_finite_points_or_one_error(place):
    *outer, last = place
    for value in given_values():
        message = copy.deepcopy(WHOLE)
        reduce(getitem, outer, message)[last] = value
        read(message)


@given(st.binary(min_size=88, max_size=88), st.booleans())
@few(0.1)
def test_any_bytes_are_finite_points_where_a_cloud_is_not_dense(data, bigendian):
    assert read(organised(bigendian=bigendian) | {"data": data}) is not None


@pytest.mark.parametrize(("datatype", "letter"), list(enumerate("bBhHiIfd", start=1)))
@pytest.mark.parametrize("order", "<>")
def test_every_datatype_of_the_definition_is_read(datatype, letter, order):
    """The enumeration of `sensor_msgs/msg/PointField` in the letters of `struct`."""
    fields = [
        {"name": name, "offset": 8 * k, "datatype": datatype, "count": 1}
        for k, name in enumerate("xyz")
    ]
    point = [1.0, 200.0 if letter in "BHI" else -100.0, 0.0]
    numbers = point if letter in "fd" else [int(number) for number in point]
    data = b"".join(struct.pack(order + letter, one).ljust(8, b"\xff") for one in numbers)
    changed = {"fields": fields, "point_step": 24, "row_step": 24, "data": data}
    size = {"width": 1, "height": 1, "is_bigendian": order == ">"}
    assert points_of_message(organised() | changed | size).tolist() == [point]
