"""Zero-copy access to the points of a sensor_msgs/PointCloud2."""

import numpy as np

from revisit.errors import InputError
from revisit.recordings.recording import time_of_points

FLOATS = {7: 'f4', 8: 'f8'}
TYPES = {1: 'int8', 2: 'uint8', 3: 'int16', 4: 'uint16', 5: 'int32', 6: 'uint32', 7: 'float32', 8: 'float64'}


def fields_of(message):
    """Returns offset [bytes] and dtype of x, y and z. Raises InputError if one is missing or not floating-point."""
    by_name = {field.name: field for field in reversed(message.fields)}  # the first of a name, as ROS
    found = []
    for axis in 'xyz':
        field = by_name.get(axis)
        if field is None:
            raise InputError(f'PointCloud2: expected a field {axis}, found {", ".join(by_name) or "none"}')
        if field.datatype not in FLOATS or field.count > 1:
            count = f' x {field.count}' if field.count > 1 else ''
            raise InputError(f'PointCloud2: field {axis}: expected float32 or float64, found '
                             f'{TYPES.get(field.datatype, field.datatype)}{count}')
        number = np.dtype(('>' if message.is_bigendian else '<') + FLOATS[field.datatype])
        if field.offset + number.itemsize > message.point_step:
            raise InputError(f'PointCloud2: field {axis} ends at byte {field.offset + number.itemsize}, beyond point_step '
                             f'{message.point_step}')
        found.append((field.offset, number))
    return found


def row_step_of(message):
    """Returns the bytes of a row. Drivers may leave row_step unset, or set it to nonsense, where the size determines it."""
    packed = message.width * message.point_step
    if message.height == 1:
        return packed
    if message.row_step < packed or (message.height - 1) * message.row_step + packed > len(message.data):
        return packed if len(message.data) == message.height * packed else message.row_step
    return message.row_step


def points_of(message):
    """Returns points, float32 [n][3], and RecordedTimes or None.

    message: of rosbags or ROS. NaN is kept; an organized cloud is read row by row. Points are not copied if x, y, z are
    float32 in native byte order, evenly spaced, and rows have no padding. Raises InputError for a truncated message.
    """
    width, height, step = message.width, message.height, message.point_step
    if width * height == 0:  # some drivers omit the fields of an empty cloud
        return np.empty((0, 3), np.float32), None
    fields = fields_of(message)
    row = row_step_of(message)
    data = np.frombuffer(message.data, np.uint8)
    if row < width * step or (height - 1) * row + width * step > data.size:
        raise InputError(f'PointCloud2: expected {height} x {width} points of {step} bytes in rows of {row}, found {data.size} bytes')

    def column(offset, number):
        return np.ndarray((height, width), number, data, offset, (row, step))

    def values_of(name):
        for field in message.fields:
            if field.name == name and field.count <= 1 and field.datatype in TYPES:
                number = np.dtype(TYPES[field.datatype]).newbyteorder('>' if message.is_bigendian else '<')
                return column(field.offset, number) if field.offset + number.itemsize <= step else None
        return None

    (x, number), (y, of_y), (z, of_z) = fields
    if number == of_y == of_z and y - x == z - y > 0:
        points = np.ndarray((height, width, 3), number, data, x, (row, step, y - x))
    else:
        points = np.stack([column(offset, of) for offset, of in fields], -1)
    times = time_of_points([field.name for field in message.fields], values_of)
    return points.reshape(-1, 3).astype(np.float32, copy=False), times
