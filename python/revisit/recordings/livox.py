"""Livox's CustomMsg of ROS 1 and 2."""

import numpy as np

from revisit.errors import InputError
from revisit.recordings.recording import RecordedTimes

CUSTOM = 'livox_ros_driver2/msg/CustomMsg'
DEFINITIONS = {
    'livox_ros_driver2/msg/CustomPoint': 'uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n',
    CUSTOM: 'std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n'
            'livox_ros_driver2/CustomPoint[] points\n'}
PACKAGES = ('livox_ros_driver2', 'livox_ros_driver', 'livox_interfaces')
"""Packages with this message. The definitions of all are the same."""
CERTAIN_NOISE = 1
"""Bits 0 and 1 of a tag judge a point by its neighbors, bits 2 and 3 by its intensity: 0 normal, 1 noise of high confidence,
2 of moderate, 3 of low (Livox's manuals, "tag information")."""


def points_of_custom(message):
    """Returns points, float32 [n][3], and RecordedTimes in ns. Points that the sensor is certain are noise become NaN."""
    points = message.points
    if len(points) != message.point_num:
        raise InputError(f'CustomMsg: expected {message.point_num} points, found {len(points)}')
    found = np.array([(point.x, point.y, point.z) for point in points], np.float32).reshape(-1, 3)
    tags = np.array([point.tag for point in points], np.uint8)
    found[((tags & 3) == CERTAIN_NOISE) | ((tags >> 2 & 3) == CERTAIN_NOISE)] = np.nan
    offsets = np.array([point.offset_time for point in points], np.uint64)
    return found, RecordedTimes('offset_time', message.timebase + offsets)
