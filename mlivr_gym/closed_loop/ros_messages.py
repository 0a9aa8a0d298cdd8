"""Point clouds in the layout of ROS 2.

Messages are plain data with the fields of the message definitions, so that ROS is not needed here;
`trajectory_files.joint_trajectory_message` makes those of joint trajectories.
Within ROS 2, `rosidl_runtime_py.message_to_ordereddict` makes such data of a message, and
`rosidl_runtime_py.set_message_fields` a message of such data.

The definitions of `sensor_msgs/msg/PointCloud2`, `sensor_msgs/msg/PointField` and
`std_msgs/msg/Header` are those of https://github.com/ros2/common_interfaces, that of
`builtin_interfaces/msg/Time` is in https://github.com/ros2/rcl_interfaces.
"""

from __future__ import annotations

import array
from typing import Any

import numpy as np

from mlivr_gym.arguments import ANY_NUMBER, NOT_NEGATIVE, Reader, Validators, checked
from mlivr_gym.arrays import Array
from mlivr_gym.closed_loop.known_boxes import HITS
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.motion.trajectory_files import message_header
from mlivr_gym.schema import FieldPath, Fields, Flag, Integer, ListOf, OrNone, Text, Tuples

FRAME = "module"
"""Name of the module frame in messages."""

CLOCK_TOLERANCE = 0.05
"""Time by which a message may be ahead of the present time, for clocks of two computers [s]."""

DATATYPES = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8",
}  # fmt: skip
"""NumPy type of each datatype of `sensor_msgs/msg/PointField`."""


def _read_bytes(value: object, place: FieldPath) -> bytes:
    """Return bytes, or whole numbers from 0 to 255 in a list or an array, as bytes."""
    if isinstance(value, (bytes, bytearray)):
        return bytes(value)
    refused = place.refused(value, "bytes, or a list of whole numbers from 0 to 255")
    if not isinstance(value, (list, tuple, array.array, np.ndarray)):
        raise refused
    try:
        found = np.asarray(value)
    except (ValueError, OverflowError):  # rows of different lengths
        raise refused from None
    if found.ndim == 1 and not found.size:
        return b""
    if found.ndim != 1 or found.dtype.kind not in "iu" or found.min() < 0 or found.max() > 255:
        raise refused
    return found.astype(np.uint8).tobytes()


UINT32 = Integer(0, 2**32 - 1)
"""Validator of a number of 32 bits."""

STAMP = Fields({"sec": Integer(-(2**31), 2**31 - 1), "nanosec": Integer(0, 10**9 - 1)}, others=True)
"""Fields of `builtin_interfaces/msg/Time`."""

POINT_FIELD = Fields(
    {"name": Text(), "offset": UINT32, "datatype": Integer(0, 255), "count": UINT32}, others=True
)
"""Fields of `sensor_msgs/msg/PointField`."""

POINT_CLOUD = Fields(
    {
        "header": Fields({"stamp": STAMP, "frame_id": Text(0)}, others=True),
        "height": UINT32,
        "width": UINT32,
        "fields": ListOf(POINT_FIELD, 0, 1000),
        "is_bigendian": Flag(),
        "point_step": UINT32,
        "row_step": UINT32,
        "data": Reader(_read_bytes),
        "is_dense": Flag(),
    },
    others=True,
)
"""Fields of `sensor_msgs/msg/PointCloud2`."""

GIVEN: Validators = {
    "points": HITS,
    "time": Tuples((), -(2.0**31), 2.0**31 - 1.0, "s"),
    "frame": Text(),
    "message": POINT_CLOUD,
    "now": OrNone(ANY_NUMBER),
    "latest": OrNone(NOT_NEGATIVE),
}
"""Validators of the arguments."""

MESSAGE = FieldPath("message", SettingError)
"""Place of a message in errors."""


@checked(GIVEN)
def point_cloud_message(points: Array, time: float, frame: str = FRAME) -> dict[str, Any]:
    """Return points as `sensor_msgs/msg/PointCloud2` with the fields x, y and z in float32.

    The points are positions in a frame of some name [m], shape (k, 3), measured at a time [s].
    Raises a `SettingError` if an argument is invalid; points, for example, that are not finite.
    """
    return {
        "header": message_header(time, frame), "height": 1, "width": len(points),
        "fields": [
            {"name": name, "offset": 4 * k, "datatype": 7, "count": 1}
            for k, name in enumerate("xyz")
        ],
        "is_bigendian": False, "point_step": 12, "row_step": 12 * len(points),
        "data": points.astype("<f4").tobytes(), "is_dense": True,
    }  # fmt: skip


@checked(GIVEN)
def points_of_message(
    message: dict[str, Any],
    *,
    frame: str = FRAME,
    now: float | None = None,
    latest: float | None = None,
) -> Array:
    """Return the points of a `sensor_msgs/msg/PointCloud2` for `Belief.add_hits`.

    Parameters
    ----------
    message
        The message as plain data. Fields that the definition does not have are ignored.
    frame
        Name of the frame in which its points must be.
    now
        The present time on the clock of the message [s]. Without it the age is not checked; with
        it, a message from later than `CLOCK_TOLERANCE` after it is refused.
    latest
        Largest age of the message at `now` [s]; by default any age will do.

    Returns
    -------
    Array
        Positions [m], shape (k, 3), without the invalid points of a cloud that is not dense.

    Raises
    ------
    SettingError
        If a field is missing or invalid, or the fields do not fit together; if the message is in
        another frame, too old or from the future; or if a point of a dense cloud is not finite. The
        error names the field, its value and what is valid.

    Examples
    --------
    >>> message = point_cloud_message([[1.0, 2.0, 3.0]], time=5.0)
    >>> points_of_message(message, now=5.1, latest=0.2).tolist()
    [[1.0, 2.0, 3.0]]
    """
    given = message["header"]["frame_id"]
    if given != frame:
        raise MESSAGE.field("header.frame_id").refused(given, repr(frame))
    _check_age(message["header"]["stamp"], now, latest)
    rows, columns = message["height"], message["width"]
    step, row, data = message["point_step"], message["row_step"], message["data"]
    if columns * step > row:
        kind = f"at least width * point_step = {columns} * {step} = {columns * step}"
        raise MESSAGE.field("row_step").refused(row, kind)
    if len(data) != rows * row:
        raise MESSAGE.field("data").fault(
            f"has {len(data)} bytes; it must have height * row_step = {rows} * {row} = {rows * row}"
        )
    points = np.stack([_coordinate(message, name) for name in "xyz"], axis=-1)
    is_finite = np.isfinite(points).all(axis=1)
    if message["is_dense"] and not is_finite.all():
        first = int(np.argmin(is_finite))
        raise MESSAGE.field("is_dense").fault(
            f"is true, but point {first} is {shortened(points[first].tolist())}; it must be false "
            "where points may be invalid"
        )
    valid: Array = points[is_finite]
    return valid


def _check_age(stamp: dict[str, int], now: float | None, latest: float | None) -> None:
    """Check that a message is neither too old nor from the future."""
    place, time = MESSAGE.field("header.stamp"), "the present time"
    if now is None:
        if latest is not None:
            raise SettingError(f"latest is {latest:g}, but now is not given; it must be {time}")
        return
    age = now - stamp["sec"] - 1e-9 * stamp["nanosec"]
    if latest is not None and age > latest:
        raise place.fault(f"is {age:g} s before {time}; at most {latest:g} s are valid")
    if age < -CLOCK_TOLERANCE:
        raise place.fault(f"is {-age:g} s after {time}; at most {CLOCK_TOLERANCE:g} s are valid")


def _coordinate(message: dict[str, Any], name: str) -> Array:
    """Return one coordinate of all points of a cloud whose size was checked, shape (k,)."""
    names, place = [field["name"] for field in message["fields"]], MESSAGE.field("fields")
    if names.count(name) != 1:
        raise place.fault(
            f"has {names.count(name)} fields {name!r} among {shortened(names)}; it must have one"
        )
    number, step = names.index(name), message["point_step"]
    field, place = message["fields"][number], place.entry(number)
    if field["datatype"] not in DATATYPES:
        raise place.field("datatype").refused(field["datatype"], "a whole number from 1 to 8")
    if field["count"] != 1:
        raise place.field("count").refused(field["count"], "1")
    order = ">" if message["is_bigendian"] else "<"
    kind = np.dtype(order + DATATYPES[field["datatype"]])
    if field["offset"] + kind.itemsize > step:
        raise place.field("offset").fault(
            f"is {field['offset']}; {kind.itemsize} bytes from there must fit in point_step, {step}"
        )
    shape = message["height"], message["width"]
    if not shape[0] * shape[1]:
        return np.zeros(0)
    view = np.ndarray(shape, kind, message["data"], field["offset"], (message["row_step"], step))
    with np.errstate(invalid="ignore"):  # of signalling NaN
        coordinate: Array = view.astype(np.float64).ravel()
    return coordinate
