"""Point clouds in the layout of ROS 2.

Messages are plain data with the fields of the message definitions, so that ROS is not needed here;
`trajectory_files.joint_trajectory_message` makes those of joint trajectories.
Within ROS 2, `rosidl_runtime_py.message_to_ordereddict` makes such data of a message, and
`rosidl_runtime_py.set_message_fields` a message of such data.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mlivr_gym.arrays import Array
from mlivr_gym.errors import SettingError, shortened
from mlivr_gym.motion.trajectory_files import message_header

FRAME = "module"
"""Name of the module frame in messages."""

DATATYPES = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8",
}  # fmt: skip
"""NumPy type of each datatype of `sensor_msgs/msg/PointField`."""

CLOUD_FIELDS = (
    "header", "height", "width", "fields", "is_bigendian", "point_step", "row_step", "data",
    "is_dense",
)  # fmt: skip
"""Fields of `sensor_msgs/msg/PointCloud2`."""


def point_cloud_message(points: Array, time: float, frame: str = FRAME) -> dict[str, Any]:
    """Return points as `sensor_msgs/msg/PointCloud2` with the fields x, y and z in float32.

    Parameters
    ----------
    points
        Positions in the frame [m], shape (k, 3).
    time
        Time of the measurement [s].
    frame
        Name of the frame.
    """
    return {
        "header": message_header(time, frame), "height": 1, "width": len(points),
        "fields": [
            {"name": name, "offset": 4 * k, "datatype": 7, "count": 1}
            for k, name in enumerate("xyz")
        ],
        "is_bigendian": False, "point_step": 12, "row_step": 12 * len(points),
        "data": np.asarray(points, dtype="<f4").tobytes(), "is_dense": True,
    }  # fmt: skip


def points_of_message(
    message: Mapping[str, Any], *, frame: str = FRAME, now: float = 0.0, latest: float = np.inf
) -> Array:
    """Return the points of a `sensor_msgs/msg/PointCloud2` for `Belief.add_hits`.

    Parameters
    ----------
    message
        The message as plain data.
    frame
        Name of the frame in which its points must be.
    now
        The present time on the clock of the message [s].
    latest
        Largest age of the message [s]; by default any age will do.

    Returns
    -------
    Array
        Positions [m], shape (k, 3), without the invalid points of a cloud that is not dense.

    Raises
    ------
    SettingError
        If the message lacks a field, is in another frame, is too old, or has data of another size
        or, if it is dense, points that are not finite.

    Examples
    --------
    >>> message = point_cloud_message([[1.0, 2.0, 3.0]], time=5.0)
    >>> points_of_message(message, now=5.1, latest=0.2).tolist()
    [[1.0, 2.0, 3.0]]
    """
    missing = [name for name in CLOUD_FIELDS if name not in message]
    if missing:
        raise SettingError(f"a point cloud lacks {missing[0]!r}; it has {', '.join(message)}")
    given, at = message["header"]["frame_id"], message["header"]["stamp"]
    if given != frame:
        raise SettingError(f"a point cloud is in frame {shortened(given)}, expected is {frame!r}")
    age = now - at["sec"] - 1e-9 * at["nanosec"]
    if not age <= latest:
        raise SettingError(f"a point cloud is {age:g} s old, at most {latest:g} s are allowed")
    points = np.stack([_coordinate(message, name) for name in "xyz"], axis=-1)
    is_finite = np.isfinite(points).all(axis=1)
    if message["is_dense"] and not is_finite.all():
        raise SettingError(
            f"point {int(np.argmin(is_finite))} of a dense point cloud is not finite; set is_dense "
            "to false if points may be invalid"
        )
    valid: Array = points[is_finite]
    return valid


def _coordinate(message: Mapping[str, Any], name: str) -> Array:
    """Return one coordinate of all points of a cloud, shape (k,)."""
    step, row, data = message["point_step"], message["row_step"], bytes(message["data"])
    rows, columns = message["height"], message["width"]
    fields = {field["name"]: field for field in message["fields"]}
    if name not in fields:
        raise SettingError(f"a point cloud has no field {name!r}; it has {', '.join(fields)}")
    field = fields[name]
    if field["datatype"] not in DATATYPES:
        raise SettingError(f"field {name!r} of a point cloud has datatype {field['datatype']}")
    order = ">" if message["is_bigendian"] else "<"
    kind = np.dtype(order + DATATYPES[field["datatype"]])
    fits = field["offset"] + kind.itemsize <= step and columns * step <= row
    if not fits or len(data) != rows * row:
        raise SettingError(
            f"a point cloud has {len(data)} bytes, which are not {rows} rows of {row} bytes with "
            f"{columns} points of {step} bytes"
        )
    if not rows * columns:
        return np.zeros(0)
    view = np.ndarray((rows, columns), kind, data, field["offset"], (row, step))
    coordinate: Array = view.astype(np.float64).ravel()
    return coordinate
